#include "cocalib/calibrators/camera_exploration.h"

#include <algorithm>
#include <utility>

#include "cocalib/visual/board_detector.h"
#include "cocalib/visual/feature_tracker.h"

namespace cocalib {
namespace {

constexpr double kRotationSpan_s = 0.12;  // between the pictures of one relative rotation
constexpr double kMaxRotationSpan_s = 0.3;
constexpr double kBoardShare = 0.25;  // of the pictures must show the board for it to carry the alignment
constexpr std::size_t kMinBoardViews = 30;
constexpr double kBoardPositionSigma_m = 0.01;

}  // namespace

std::vector<SensorPose> CameraExploration::boardPoses(const std::vector<VisualKeyframe>& frames) const {
  std::vector<SensorPose> poses;
  if (!board_) return poses;
  for (const VisualKeyframe& frame : frames) {
    if (!frame.board) continue;
    const auto T_C_B = estimateBoardPose(*frame.board, *board_, camera_);
    if (T_C_B) poses.push_back({frame.stamp, T_C_B->inverse()});
  }
  return poses;
}

std::vector<RelativeSensorRotation> CameraExploration::rotations(const std::vector<VisualKeyframe>& frames,
                                                                 const std::vector<SensorPose>& board_poses) {
  turns_.erase(turns_.begin(), turns_.lower_bound({frames.front().stamp, 0}));
  std::vector<RelativeSensorRotation> out;
  const auto boardAt = [&](TimeNs stamp) {
    const auto it = std::lower_bound(board_poses.begin(), board_poses.end(), stamp,
                                     [](const SensorPose& pose, TimeNs t) { return pose.stamp < t; });
    return it != board_poses.end() && it->stamp == stamp ? &*it : nullptr;
  };
  std::size_t a = 0;
  for (std::size_t b = 1; b < frames.size(); ++b) {
    if (toSeconds(frames[b].stamp - frames[a].stamp) < kRotationSpan_s) continue;
    const SensorPose *pose_a = boardAt(frames[a].stamp), *pose_b = boardAt(frames[b].stamp);
    if (toSeconds(frames[b].stamp - frames[a].stamp) <= kMaxRotationSpan_s) {
      if (pose_a && pose_b) {
        out.push_back({frames[a].stamp, frames[b].stamp, pose_a->T_M_S.q.conjugate() * pose_b->T_M_S.q});
      } else if (const auto& turn = turnBetween(frames[a], frames[b])) {
        out.push_back({frames[a].stamp, frames[b].stamp, *turn});
      }
    }
    // Overlapping spans: the next begins half-way, where there is a picture.
    while (a + 1 < b && toSeconds(frames[b].stamp - frames[a + 1].stamp) >= 0.5 * kRotationSpan_s) ++a;
    if (toSeconds(frames[b].stamp - frames[a].stamp) > kMaxRotationSpan_s) a = b;
  }
  return out;
}

const std::optional<Eigen::Quaterniond>& CameraExploration::turnBetween(const VisualKeyframe& a,
                                                                        const VisualKeyframe& b) {
  const auto [turn, is_new] = turns_.try_emplace({a.stamp, b.stamp});
  if (is_new) {
    if (const auto relative = relativeRotation(a.tracks, b.tracks, camera_)) turn->second = relative->R_b_a.conjugate();
  }
  return turn->second;
}

std::vector<BearingFrame> CameraExploration::bearings(const std::vector<VisualKeyframe>& frames) const {
  std::vector<BearingFrame> all;
  for (const VisualKeyframe& frame : frames) {
    BearingFrame out;
    out.stamp = frame.stamp;
    for (const TrackObservation& track : frame.tracks) {
      const auto bearing = camera_.unproject(track.px.cast<double>());
      if (!bearing) continue;
      out.ids.push_back(track.id);
      out.bearings_C.push_back(*bearing);
    }
    all.push_back(std::move(out));
  }
  return all;
}

/// Poses only where the board carries the alignment; tracks have no metric ones.
SensorMotion CameraExploration::ownMotion(const std::vector<VisualKeyframe>& frames) {
  SensorMotion motion;
  motion.poses = boardPoses(frames);
  motion.position_sigma_m = kBoardPositionSigma_m;
  motion.rotations = rotations(frames, motion.poses);
  const double share = static_cast<double>(motion.poses.size()) / static_cast<double>(frames.size());
  if (motion.poses.size() >= kMinBoardViews && share >= kBoardShare) return motion;
  motion.poses.clear();
  motion.bearings = bearings(frames);
  return motion;
}

std::optional<Alignment> CameraExploration::align(const ImuBuffer& imu, const std::vector<VisualKeyframe>& frames,
                                                  std::string* reason) {
  const SensorMotion motion = ownMotion(frames);
  const auto rotation = initializeRotation(imu, motion.rotations, RotationInitializerParams(), reason);
  if (!rotation) return std::nullopt;
  OpenStart start{*rotation, AlignmentParams()};
  if (!motion.poses.empty()) start.alignment.position_sigma_m = motion.position_sigma_m;
  return alignFrom(imu, motion, start, reason);
}

std::optional<Alignment> CameraExploration::alignOpenly(const ImuBuffer& imu, const std::vector<VisualKeyframe>& frames,
                                                        const std::optional<Pose>& guess_T_imu_camera,
                                                        std::string* reason) {
  const SensorMotion motion = ownMotion(frames);
  const auto start = openStart(imu, motion, guess_T_imu_camera, reason);
  if (!start) return std::nullopt;
  return alignFrom(imu, motion, *start, reason);
}

std::optional<Alignment> CameraExploration::alignFrom(const ImuBuffer& imu, const SensorMotion& motion,
                                                      const OpenStart& start, std::string* reason) const {
  if (!motion.poses.empty()) return alignFromPoses(imu, start.rotation, motion.poses, start.alignment, reason);
  return alignFromTracks(imu, start.rotation, motion.bearings, start.alignment, reason);
}

bool CameraExploration::seesEnough(const std::vector<VisualKeyframe>& frames) const {
  constexpr std::size_t kFewestTracks = 15;
  const auto seeing = std::count_if(frames.begin(), frames.end(), [&](const VisualKeyframe& frame) {
    return (board_ && frame.board) || frame.tracks.size() >= kFewestTracks;
  });
  return 2 * static_cast<std::size_t>(seeing) > frames.size() && frames.size() >= kMinBoardViews;
}

VisualKeyframe thinTracks(const VisualKeyframe& frame, double rate_hz) {
  // A function of the stamp alone, so that calibrator and fuser agree: of every 1 / rate, the first 60 ms (one picture
  // at 16.7 Hz, every third of 50) keep their tracks.
  constexpr TimeNs kOnePicture = 60000000;
  VisualKeyframe out = frame;
  const TimeNs period = toNs(1.0 / rate_hz);
  if (frame.stamp % period >= kOnePicture) out.tracks.clear();
  return out;
}

}  // namespace cocalib
