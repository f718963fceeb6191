#include "cocalib/estimation/camera_group.h"

#include <algorithm>
#include <cmath>

#include "cocalib/estimation/pose_scatter.h"
#include "cocalib/factors/point_factors.h"
#include "cocalib/factors/robust.h"

namespace cocalib {

/// Quadratics over camera poses, summed over all features before they are scattered to the states.
struct CameraGroup::Sums {
  explicit Sums(std::size_t frames) : H(frames, Matrix6d::Zero()), b(frames, Vector6d::Zero()), pairs(frames) {}
  const std::vector<TimedSensorPose>* poses = nullptr;
  std::vector<Matrix6d> H;
  std::vector<Vector6d> b;
  std::vector<std::map<int, Matrix6d>> pairs;  // [i][j], i < j
  double cost = 0.0;
  double corner_square_px = 0.0, track_square_px = 0.0;  // mean over both axes
  std::size_t corners = 0, track_observations = 0;
};

void CameraGroup::addFrame(const VisualKeyframe& keyframe) {
  const int index = frames();
  frames_.push_back({keyframe.stamp, -1, keyframe.board});
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
  for (auto& entry : landmarks_) {
    Landmark& landmark = entry.second;
    if (!landmark.ready && landmark.observations.size() >= 3) triangulate(&landmark, poses);
    if (landmark.ready) gate(&landmark, poses);
  }
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
    for (const auto& [j, H] : sums.pairs[i]) {
      const auto k = static_cast<std::size_t>(j);
      scatterPosePair(poses_[i], frames_[i].node, poses_[k], frames_[k].node, column, H, system);
    }
  }
  system->cost += sums.cost;
  if (sums.corners > 0) corner_rms_px_ = std::sqrt(sums.corner_square_px / static_cast<double>(sums.corners));
  if (sums.track_observations > 0) {
    track_rms_px_ = std::sqrt(sums.track_square_px / static_cast<double>(sums.track_observations));
  }
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
    const Eigen::Matrix<double, 2, 6> J_B = f_px->J_point * pointJacobian(state.T_W_B, p_B);
    const Eigen::Matrix<double, 6, 2> wJ_c = robust.weight * f_px->J_pose.transpose();
    const Eigen::Matrix<double, 6, 2> wJ_B = robust.weight * J_B.transpose();
    sums->H[f].noalias() += wJ_c * f_px->J_pose;
    sums->b[f].noalias() += wJ_c * f_px->r;
    H_cB.noalias() += wJ_c * J_B;
    H_BB.noalias() += wJ_B * J_B;
    b_B.noalias() += wJ_B * f_px->r;
    sums->cost += robust.cost;
    sums->corner_square_px += 0.5 * f_px->r.squaredNorm() * params_.corner_sigma_px * params_.corner_sigma_px;
    ++sums->corners;
  }
  scatterPoseGlobal(poses_[f], frames_[f].node, GlobalLayout::kCamera, H_cB, kB, system);
  system->H_global.block<6, 6>(kB, kB) += H_BB;
  system->b_global.segment<6>(kB) += b_B;
}

void CameraGroup::learnCornerSigma() {
  constexpr double kMinSigma_px = 0.04, kMaxSigma_px = 2.0;
  if (corner_rms_px_ > 0.0) params_.corner_sigma_px = std::clamp(corner_rms_px_, kMinSigma_px, kMaxSigma_px);
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

// --- landmarks ---------------------------------------------------------------------------------------------------

namespace {

// Weak knowledge of inverse depth: 0.2 +- 1 per metre covers 0.8 m to infinity and keeps far points regular.
constexpr double kPriorInverseDepth = 0.2;
constexpr double kPriorInverseDepthSigma = 1.0;
constexpr double kMinInverseDepth = 1e-3;

Eigen::Vector3d landmarkPoint(const Pose& T_W_A, const Eigen::Vector3d& uv_rho) {
  return T_W_A * (Eigen::Vector3d(uv_rho.x(), uv_rho.y(), 1.0) / uv_rho.z());
}

Eigen::Matrix3d landmarkJacobian(const Pose& T_W_A, const Eigen::Vector3d& uv_rho) {
  const double depth = 1.0 / uv_rho.z();
  Eigen::Matrix3d J_A;
  J_A << depth, 0.0, -uv_rho.x() * depth * depth, 0.0, depth, -uv_rho.y() * depth * depth, 0.0, 0.0, -depth * depth;
  return T_W_A.R() * J_A;
}

}  // namespace

void CameraGroup::triangulate(Landmark* landmark, const std::vector<TimedSensorPose>& poses) const {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  const Observation& middle = landmark->observations[landmark->observations.size() / 2];
  landmark->T_W_A = poses[static_cast<std::size_t>(middle.frame)].T_W_S;
  for (const Observation& o : landmark->observations) {
    const auto bearing_C = params_.camera.unproject(o.px);
    if (!bearing_C) return;
    const Pose& T_W_C = poses[static_cast<std::size_t>(o.frame)].T_W_S;
    const Eigen::Vector3d ray = T_W_C.q * *bearing_C;
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    A += across;
    b += across * (T_W_C.t - landmark->T_W_A.t);
  }
  const auto bearing_A = params_.camera.unproject(middle.px);
  if (!bearing_A || bearing_A->z() < 0.1) return;
  // Nearly parallel rays tell no depth: start at the prior then, the solve will find what there is to find.
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(A);
  double rho = kPriorInverseDepth;
  if (ldlt.rcond() > 1e-5) {
    const Eigen::Vector3d p_A = landmark->T_W_A.q.conjugate() * ldlt.solve(b);
    if (p_A.z() > 0.1 && p_A.z() < 200.0) rho = 1.0 / p_A.z();
  }
  landmark->uv_rho << bearing_A->x() / bearing_A->z(), bearing_A->y() / bearing_A->z(), rho;
  landmark->ready = true;
}

void CameraGroup::gate(Landmark* landmark, const std::vector<TimedSensorPose>& poses) const {
  const Eigen::Vector3d p_W = landmarkPoint(landmark->T_W_A, landmark->uv_rho);
  for (Observation& o : landmark->observations) {
    const auto f =
        reprojection(poses[static_cast<std::size_t>(o.frame)].T_W_S, p_W, o.px, params_.track_sigma_px, params_.camera);
    // Far off now may be fine after the next step: the gate is wide, and an observation may come back.
    o.used = f && f->r.norm() < 4.0 * params_.gate_sigmas;
  }
}

void CameraGroup::addLandmark(Landmark* landmark, Sums* sums) const {
  Landmark& l = *landmark;
  const Eigen::Vector3d p_W = landmarkPoint(l.T_W_A, l.uv_rho);
  const Eigen::Matrix3d J_l = landmarkJacobian(l.T_W_A, l.uv_rho);
  const double prior = (l.uv_rho.z() - kPriorInverseDepth) / kPriorInverseDepthSigma;
  Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
  V(2, 2) = 1.0 / (kPriorInverseDepthSigma * kPriorInverseDepthSigma);
  Eigen::Vector3d g(0.0, 0.0, prior / kPriorInverseDepthSigma);
  double cost = 0.5 * prior * prior;
  l.W.clear();
  std::vector<std::pair<Matrix6d, Vector6d>> own;
  for (const Observation& o : l.observations) {
    if (!o.used) continue;
    const auto f = static_cast<std::size_t>(o.frame);
    const auto r = reprojection((*sums->poses)[f].T_W_S, p_W, o.px, params_.track_sigma_px, params_.camera);
    if (!r) continue;
    const RobustWeight robust = huber(r->r.squaredNorm(), params_.huber_sigmas);
    const Eigen::Matrix<double, 2, 3> J = r->J_point * J_l;
    V.noalias() += robust.weight * J.transpose() * J;
    g.noalias() += robust.weight * J.transpose() * r->r;
    l.W.emplace_back(o.frame, robust.weight * r->J_pose.transpose() * J);
    own.emplace_back(robust.weight * r->J_pose.transpose() * r->J_pose, robust.weight * r->J_pose.transpose() * r->r);
    cost += robust.cost;
    sums->track_square_px += 0.5 * r->r.squaredNorm() * params_.track_sigma_px * params_.track_sigma_px;
  }
  const Eigen::LLT<Eigen::Matrix3d> llt(V);
  if (l.W.size() < 2 || llt.info() != Eigen::Success) return;
  sums->track_observations += l.W.size();
  sums->cost += cost;
  l.eliminated = true;
  l.V_inverse = llt.solve(Eigen::Matrix3d::Identity());
  l.gradient = g;
  for (std::size_t a = 0; a < l.W.size(); ++a) {
    const auto f = static_cast<std::size_t>(l.W[a].first);
    const Eigen::Matrix<double, 6, 3> W_V = l.W[a].second * l.V_inverse;
    sums->H[f].noalias() += own[a].first - W_V * l.W[a].second.transpose();
    sums->b[f].noalias() += own[a].second - W_V * g;
    for (std::size_t c = a + 1; c < l.W.size(); ++c) {
      sums->pairs[f].try_emplace(l.W[c].first, Matrix6d::Zero()).first->second.noalias() -=
          W_V * l.W[c].second.transpose();
    }
  }
}

void CameraGroup::moveLandmarks(const ChainSystem::Step& step) {
  std::vector<Vector6d> moved(frames_.size());
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    moved[i] = poses_[i].J_state * step.nodes[static_cast<std::size_t>(frames_[i].node)] +
               poses_[i].J_calibration * step.globals.segment<7>(GlobalLayout::kCamera) +
               poses_[i].J_gravity * step.globals[GlobalLayout::kGravity];
  }
  for (auto& entry : landmarks_) {
    Landmark& l = entry.second;
    l.previous = l.uv_rho;
    if (!l.eliminated) continue;
    Eigen::Vector3d rhs = l.gradient;
    for (const auto& [frame, W] : l.W) rhs.noalias() += W.transpose() * moved[static_cast<std::size_t>(frame)];
    l.uv_rho -= l.V_inverse * rhs;
    l.uv_rho.z() = std::max(l.uv_rho.z(), kMinInverseDepth);
  }
}

void CameraGroup::revertLandmarks() {
  for (auto& entry : landmarks_) entry.second.uv_rho = entry.second.previous;
}

}  // namespace cocalib
