#include "cocalib/estimation/camera_group.h"

#include <algorithm>
#include <cmath>

#include "camera_sums.h"
#include "cocalib/estimation/pose_scatter.h"
#include "cocalib/factors/point_factors.h"
#include "cocalib/factors/robust.h"

namespace cocalib {

void CameraGroup::addFrame(const VisualKeyframe& keyframe) {
  const int index = frames();
  frames_.push_back({keyframe.stamp, -1, keyframe.board, std::nullopt});
  for (const TrackObservation& track : keyframe.tracks) {
    const auto newest = newest_of_.find(track.id);
    auto landmark = newest == newest_of_.end() ? landmarks_.end() : landmarks_.find(newest->second);
    if (landmark == landmarks_.end() || landmark->second.observations.size() >= params_.max_track_observations) {
      newest_of_[track.id] = next_landmark_;
      landmark = landmarks_.emplace_hint(landmarks_.end(), next_landmark_++, Landmark());
    }
    landmark->second.observations.push_back({index, track.px.cast<double>()});
  }
}

int CameraGroup::boardViews() const {
  return static_cast<int>(
      std::count_if(frames_.begin(), frames_.end(), [](const Frame& f) { return f.board.has_value(); }));
}

std::optional<std::pair<TimeNs, BoardObservation>> CameraGroup::firstBoardView() const {
  for (const Frame& frame : frames_) {
    if (frame.board) return std::make_pair(frame.stamp, *frame.board);
  }
  return std::nullopt;
}

std::vector<TimedSensorPose> CameraGroup::cameraPoses(const WindowState& state, const InertialChain& chain) const {
  std::vector<TimedSensorPose> poses;
  poses.reserve(frames_.size());
  for (const Frame& frame : frames_) {
    poses.push_back(timedSensorPose(chain.segment(frame.node), state.nodes[static_cast<std::size_t>(frame.node)],
                                    state.gravity, state.calibration.T_imu_camera,
                                    state.calibration.camera_time_offset_s, frame.stamp));
  }
  return poses;
}

void CameraGroup::relink(const WindowState& state, const InertialChain& chain) {
  const TimeNs offset = toNs(state.calibration.camera_time_offset_s);
  for (Frame& frame : frames_) frame.node = nodeAt(state.nodes, frame.stamp + offset);
  const std::vector<TimedSensorPose> poses = cameraPoses(state, chain);
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (!frames_[i].weight) frames_[i].weight = repeats_.next(poses[i].T_W_S);
  }
  std::size_t observations = 0, consistent = 0;
  for (auto& entry : landmarks_) {
    Landmark& landmark = entry.second;
    if (!landmark.ready && landmark.observations.size() >= 3) triangulate(&landmark, poses);
    if (!landmark.ready) continue;
    gate(&landmark, poses);
    observations += landmark.observations.size();
    for (const Observation& o : landmark.observations) consistent += o.used;
  }
  consistent_share_ = observations > 0 ? static_cast<double>(consistent) / static_cast<double>(observations) : 1.0;
}

bool CameraGroup::touches(const Landmark& landmark, int end_node) const {
  return std::any_of(landmark.observations.begin(), landmark.observations.end(),
                     [&](const Observation& o) { return frames_[static_cast<std::size_t>(o.frame)].node < end_node; });
}

void CameraGroup::accumulate(const WindowState& state, const InertialChain& chain, int end_node, ChainSystem* system) {
  poses_ = cameraPoses(state, chain);
  Sums sums(frames_.size());
  sums.poses = &poses_;
  const auto selected = [&](const Frame& frame) { return end_node < 0 || frame.node < end_node; };

  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (frames_[i].board && params_.board && selected(frames_[i])) addBoard(state, static_cast<int>(i), &sums, system);
  }
  for (auto& entry : landmarks_) {
    entry.second.eliminated = false;
    if (entry.second.ready && (end_node < 0 || touches(entry.second, end_node))) addLandmark(&entry.second, &sums);
  }
  constexpr int column = GlobalLayout::kCamera;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    scatterPose(poses_[i], frames_[i].node, column, sums.H[i], sums.b[i], system);
    for (std::size_t j = 0; j < sums.pairs[i].frames.size(); ++j) {
      const auto k = static_cast<std::size_t>(sums.pairs[i].frames[j]);
      scatterPosePair(poses_[i], frames_[i].node, poses_[k], frames_[k].node, column, sums.pairs[i].H[j], system);
    }
  }
  system->cost += sums.cost;
  if (end_node >= 0) return;
  if (sums.corners > 0) corner_rms_px_ = std::sqrt(sums.corner_square_px / static_cast<double>(sums.corners));
  if (sums.track_observations > 0) {
    track_rms_px_ = std::sqrt(sums.track_square_px / static_cast<double>(sums.track_observations));
  }
  track_residuals_ = sums.track_noise;
}

void CameraGroup::addBoard(const WindowState& state, int frame, Sums* sums, ChainSystem* system) const {
  constexpr int kB = GlobalLayout::kBoard;
  const auto f = static_cast<std::size_t>(frame);
  const std::vector<Eigen::Vector2f>& corners = frames_[f].board->corners_px;
  Matrix6d H_cB = Matrix6d::Zero(), H_BB = Matrix6d::Zero();
  Vector6d b_B = Vector6d::Zero();
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector3d p_B = params_.board->corner(static_cast<int>(i));
    const auto f_px = reprojection(poses_[f].T_W_S, state.T_W_B * p_B, corners[i].cast<double>(),
                                   params_.corner_sigma_px, params_.camera);
    if (!f_px) continue;
    const RobustWeight robust = huber(f_px->r.squaredNorm(), params_.gate_sigmas);
    const double weight = *frames_[f].weight * robust.weight;
    const Eigen::Matrix<double, 2, 6> J_B = f_px->J_point * pointJacobian(state.T_W_B, p_B);
    const Eigen::Matrix<double, 6, 2> wJ_c = weight * f_px->J_pose.transpose();
    const Eigen::Matrix<double, 6, 2> wJ_B = weight * J_B.transpose();
    sums->H[f].noalias() += wJ_c * f_px->J_pose;
    sums->b[f].noalias() += wJ_c * f_px->r;
    H_cB.noalias() += wJ_c * J_B;
    H_BB.noalias() += wJ_B * J_B;
    b_B.noalias() += wJ_B * f_px->r;
    sums->cost += *frames_[f].weight * robust.cost;
    sums->corner_square_px += 0.5 * f_px->r.squaredNorm() * params_.corner_sigma_px * params_.corner_sigma_px;
    ++sums->corners;
  }
  scatterPoseGlobal<6>(poses_[f], frames_[f].node, GlobalLayout::kCamera, H_cB, kB, system);
  system->H_global.block<6, 6>(kB, kB) += H_BB;
  system->b_global.segment<6>(kB) += b_B;
}

bool CameraGroup::learnNoise() {
  constexpr double kMinSigma_px = 0.1, kMaxSigma_px = 2.0;
  const double corner_before = params_.corner_sigma_px;
  const TrackNoise tracks_before = params_.track_noise;
  if (corner_rms_px_ > 0.0) params_.corner_sigma_px = std::clamp(corner_rms_px_, kMinSigma_px, kMaxSigma_px);
  if (track_residuals_.ready()) params_.track_noise = track_residuals_.estimate(params_.track_noise);
  const auto differs = [](double a, double b) { return std::abs(a - b) > 0.05 * std::max(a, b); };
  return differs(corner_before, params_.corner_sigma_px) ||
         differs(tracks_before.sigma_px, params_.track_noise.sigma_px) ||
         differs(tracks_before.drift_per_s, params_.track_noise.drift_per_s);
}

void CameraGroup::dropFront(int end_node) {
  for (auto it = landmarks_.begin(); it != landmarks_.end();) {
    it = touches(it->second, end_node) ? landmarks_.erase(it) : std::next(it);
  }
  for (auto it = newest_of_.begin(); it != newest_of_.end();) {
    it = landmarks_.count(it->second) == 0 ? newest_of_.erase(it) : std::next(it);
  }
  const auto first_kept =
      std::find_if(frames_.begin(), frames_.end(), [&](const Frame& frame) { return frame.node >= end_node; });
  const int dropped = static_cast<int>(first_kept - frames_.begin());
  frames_.erase(frames_.begin(), first_kept);
  for (Frame& frame : frames_) frame.node -= end_node;
  for (auto& entry : landmarks_) {
    for (Observation& o : entry.second.observations) o.frame -= dropped;
  }
}

}  // namespace cocalib
