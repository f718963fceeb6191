#include "cocalib/sim/camera.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cocalib::sim {

int imageCount(const Scenario& scenario) {
  if (!scenario.camera.present) return 0;
  return static_cast<int>(std::floor(scenario.duration_s * scenario.camera.rate_hz + 1e-9));
}

double imageTime(const Scenario& scenario, int k) { return k / scenario.camera.rate_hz; }

TimeNs imageStamp(const Scenario& scenario, int k) {
  return scenario.epoch + toNs(imageTime(scenario, k)) - toNs(scenario.camera.time_offset_s);
}

BoardTruth trueBoard(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int k) {
  BoardTruth truth;
  truth.stamp = imageStamp(scenario, k);
  if (scene.boardIndex() < 0) return truth;
  const CameraModel camera = scenario.camera.cameraModel();
  const Pose T_W_C = trajectory.T_W_I(imageTime(scenario, k)) * scenario.camera.T_imu_camera();
  const Pose T_C_B = T_W_C.inverse() * scene.T_W_B();
  const BoardGeometry board = scenario.board.geometry();
  const bool from_front = (T_C_B.q * Eigen::Vector3d::UnitZ()).dot(T_C_B.t) > 0.0;
  truth.complete = true;
  for (int i = 0; i < board.cornerCount(); ++i) {
    const std::optional<Eigen::Vector2d> px = camera.project(T_C_B * board.corner(i));
    const double nan = std::numeric_limits<double>::quiet_NaN();
    truth.corners_px.push_back(px.value_or(Eigen::Vector2d(nan, nan)));
    const bool visible =
        from_front && px && camera.inImage(*px) && scene.visible(T_W_C.t, scene.T_W_B() * board.corner(i));
    truth.visible.push_back(visible);
    truth.complete = truth.complete && visible;
  }
  return truth;
}

std::optional<BoardObservation> simulateBoard(const Scenario& scenario, const Scene& scene,
                                              const Trajectory& trajectory, int k) {
  const BoardTruth truth = trueBoard(scenario, scene, trajectory, k);
  if (!truth.complete) return std::nullopt;
  Random random(scenario.seed, Random::Stream::kCorners, static_cast<std::uint64_t>(k));
  BoardObservation observation;
  for (const Eigen::Vector2d& px : truth.corners_px) {
    const double x = random.normal();
    const Eigen::Vector2d noise(x, random.normal());
    observation.corners_px.push_back((px + scenario.camera.corner_noise_px * noise).cast<float>());
  }
  return observation;
}

TrackSimulator::TrackSimulator(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int features,
                               double min_age_s, double max_age_s)
    : scenario_(scenario),
      scene_(scene),
      trajectory_(trajectory),
      camera_(scenario.camera.cameraModel()),
      T_I_C_(scenario.camera.T_imu_camera()),
      features_(static_cast<std::size_t>(features)),
      min_age_s_(min_age_s),
      max_age_s_(max_age_s),
      random_(scenario.seed, Random::Stream::kTracks) {}

std::optional<Eigen::Vector2d> TrackSimulator::see(const Pose& T_W_C, const Eigen::Vector3d& p_W) const {
  constexpr double kMargin_px = 5.0;  // as far from the border as a tracker's patch needs
  const std::optional<Eigen::Vector2d> px = camera_.project(T_W_C.inverse() * p_W);
  if (!px || !camera_.inImage(*px, kMargin_px) || !scene_.visible(T_W_C.t, p_W)) return std::nullopt;
  return px;
}

void TrackSimulator::topUp(const Pose& T_W_C, double t) {
  // Half of what is drawn may fall on the board; a bound keeps a camera that sees nothing else from waiting for ever.
  for (std::size_t tries = 0; tracks_.size() < features_ && tries < 20 * features_; ++tries) {
    const double x = random_.uniform(5.0, camera_.width() - 6.0);
    const Eigen::Vector2d px(x, random_.uniform(5.0, camera_.height() - 6.0));
    const double age_s = random_.uniform(min_age_s_, max_age_s_);
    const std::optional<Eigen::Vector3d> bearing = camera_.unproject(px);
    if (!bearing) continue;
    const Eigen::Vector3d direction_W = T_W_C.q * *bearing;
    const std::optional<Scene::Hit> hit = scene_.raycast(T_W_C.t, direction_W);
    if (!hit || hit->index == scene_.boardIndex()) continue;
    const Eigen::Vector3d p_W = T_W_C.t + hit->range * direction_W;
    tracks_.push_back({next_id_, p_W, t + age_s});
    landmarks_[next_id_++] = p_W;
  }
}

std::vector<TrackObservation> TrackSimulator::observe(int k) {
  const double t = imageTime(scenario_, k);
  const Pose T_W_C = trajectory_.T_W_I(t) * T_I_C_;
  const auto lost = [&](const Track& track) { return t > track.end_s || !see(T_W_C, track.p_W); };
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(), lost), tracks_.end());
  topUp(T_W_C, t);

  std::vector<TrackObservation> observations;
  observations.reserve(tracks_.size());
  for (const Track& track : tracks_) {
    const std::optional<Eigen::Vector2d> px = see(T_W_C, track.p_W);
    const double x = random_.normal();
    const Eigen::Vector2d noise(x, random_.normal());
    if (!px) continue;
    observations.push_back({track.id, (*px + scenario_.camera.track_noise_px * noise).cast<float>()});
  }
  return observations;
}

}  // namespace cocalib::sim
