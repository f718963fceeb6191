#include "cocalib/estimation/residual_samples.h"

#include <algorithm>
#include <cstddef>

#include "cocalib/estimation/inertial_window.h"
#include "cocalib/factors/imu_factor.h"
#include "cocalib/factors/point_factors.h"

namespace cocalib {
namespace {

constexpr std::size_t kMostSamples = 20'000;
constexpr int kMostScans = 40;

/// Every n-th, so that no more than kMostSamples stay.
void thin(std::vector<float>* samples) {
  const std::size_t stride = samples->size() / kMostSamples + 1;
  if (stride == 1) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < samples->size(); i += stride) (*samples)[kept++] = (*samples)[i];
  samples->resize(kept);
}

void collectImu(const InertialWindow& window, std::vector<float>* sigmas) {
  const WindowState& state = window.state();
  for (std::size_t k = 0; k + 1 < state.nodes.size() && static_cast<int>(k) < window.chain().size(); ++k) {
    const ImuFactor factor(window.chain().segment(static_cast<int>(k)), window.chain().noise());
    const Vector15d r = factor.evaluate(state.nodes[k], state.nodes[k + 1], state.gravity).r;
    for (Eigen::Index i = 0; i < 9; ++i) sigmas->push_back(static_cast<float>(r[i]));
  }
}

void collectLidar(const InertialWindow& window, std::vector<float>* distances_m) {
  const LidarGroup& lidar = *window.lidar();
  const std::vector<Plane>& planes = window.state().planes;
  const int step = lidar.scans() / kMostScans + 1;
  for (int i = 0; i < lidar.scans(); i += step) {
    const std::vector<std::int16_t>& plane_of = lidar.planesOf(i);
    const std::vector<Eigen::Vector3f> points_W = deskewToWorld(lidar.scan(i), window.state(), window.chain());
    for (std::size_t k = 0; k < std::min(points_W.size(), plane_of.size()); ++k) {
      const int plane = plane_of[k];
      if (plane < 0 || plane >= static_cast<int>(planes.size())) continue;
      distances_m->push_back(
          static_cast<float>(planes[static_cast<std::size_t>(plane)].distance(points_W[k].cast<double>())));
    }
  }
}

}  // namespace

void CameraGroup::collectResiduals(const WindowState& state, const InertialChain& chain, std::vector<float>* corners_px,
                                   std::vector<float>* tracks_px) const {
  const std::vector<TimedSensorPose> poses = cameraPoses(state, chain);
  const auto add = [&](int frame, const Eigen::Vector3d& p_W, const Eigen::Vector2d& px, std::vector<float>* out) {
    const auto f = reprojection(poses[static_cast<std::size_t>(frame)].T_W_S, p_W, px, 1.0, params_.camera);
    if (!f) return;
    for (const double axis : {f->r.x(), f->r.y()}) out->push_back(static_cast<float>(axis));
  };
  for (int i = 0; i < frames(); ++i) {
    const std::optional<BoardObservation>& board = frames_[static_cast<std::size_t>(i)].board;
    if (!board || !params_.board) continue;
    for (std::size_t k = 0; k < board->corners_px.size(); ++k) {
      add(i, state.T_W_B * params_.board->corner(static_cast<int>(k)), board->corners_px[k].cast<double>(), corners_px);
    }
  }
  for (const auto& entry : landmarks_) {
    const Landmark& landmark = entry.second;
    if (!landmark.eliminated) continue;  // not part of the last solve
    const Eigen::Vector3d& m = landmark.uv_rho;
    const Eigen::Vector3d p_W = landmark.T_W_A * (Eigen::Vector3d(m.x(), m.y(), 1.0) / m.z());
    for (const Observation& o : landmark.observations) {
      if (o.used) add(o.frame, p_W, o.px, tracks_px);
    }
  }
}

ResidualSamples collectResiduals(const InertialWindow& window) {
  ResidualSamples samples;
  if (window.state().nodes.empty() || window.chain().size() == 0) return samples;
  collectImu(window, &samples.imu_sigmas);
  if (const CameraGroup* camera = window.camera()) {
    camera->collectResiduals(window.state(), window.chain(), &samples.corners_px, &samples.tracks_px);
    samples.corner_sigma_px = camera->params().corner_sigma_px;
    samples.track_sigma_px = camera->params().track_noise.sigma_px;
  }
  if (window.lidar() && window.lidar()->scans() > 0) {
    collectLidar(window, &samples.planes_m);
    samples.plane_sigma_m = window.lidar()->rangeSigma();
  }
  for (std::vector<float>* kind : {&samples.imu_sigmas, &samples.corners_px, &samples.tracks_px, &samples.planes_m}) {
    thin(kind);
  }
  return samples;
}

}  // namespace cocalib
