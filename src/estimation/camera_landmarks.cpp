// The natural features of a CameraGroup.

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "camera_sums.h"
#include "cocalib/factors/point_factors.h"
#include "cocalib/factors/robust.h"

namespace cocalib {
namespace {

constexpr double kFirstInverseDepth = 0.2;  // 1/m, where the rays tell none yet
constexpr double kMinInverseDepth = 1e-3;
// Nothing is known of a depth beforehand. Any knowledge, however weak, is shared by hundreds of landmarks, and what
// they share is the scale: 0.2 +- 1 per metre took a scene at 0.8 m to be a tenth larger than it was. This only keeps
// the elimination of a point without parallax regular; it pulls nowhere.
constexpr double kRegularInverseDepth = 1e-4;

Eigen::Vector3d landmarkPoint(const Pose& T_W_A, const Eigen::Vector3d& uv_rho) {
  return T_W_A * (Eigen::Vector3d(uv_rho.x(), uv_rho.y(), 1.0) / uv_rho.z());
}

Eigen::Matrix3d landmarkJacobian(const Pose& T_W_A, const Eigen::Vector3d& uv_rho) {
  const double depth = 1.0 / uv_rho.z();
  Eigen::Matrix3d J_A;
  J_A << depth, 0.0, -uv_rho.x() * depth * depth, 0.0, depth, -uv_rho.y() * depth * depth, 0.0, 0.0, -depth * depth;
  return T_W_A.R() * J_A;
}

/// What a chi-square variable times its weight in Student's t comes to on average, to second order: less than its
/// degrees, since the large ones are weighed down.
double expectedWeighed(double degrees, double freedom) {
  const double all = freedom + degrees;
  return degrees * (1.0 - 2.0 * freedom / (all * all));
}

// Parts of a picture whose tracks are taken to share what is wrong with the lens model or the surface there.
constexpr std::size_t kPlaceCols = 3, kPlaceRows = 2, kPlaces = kPlaceCols * kPlaceRows;

std::size_t placeOf(const Eigen::Vector2d& px, const CameraModel& camera) {
  const auto part = [](double value, int size, std::size_t parts) {
    const double at = std::clamp(value / size, 0.0, 0.999);
    return static_cast<std::size_t>(at * static_cast<double>(parts));
  };
  return kPlaceCols * part(px.y(), camera.height(), kPlaceRows) + part(px.x(), camera.width(), kPlaceCols);
}

}  // namespace

void CameraGroup::Views::clear() {
  frames.clear();
  times_s.clear();
  places.clear();
  r.clear();
  J_pose.clear();
  J_landmark.clear();
  squared = 0.0;
}

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
  // Nearly parallel rays tell no depth: start anywhere then, the solve will find what there is to find.
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(A);
  double rho = kFirstInverseDepth;
  if (ldlt.rcond() > 1e-5) {
    const Eigen::Vector3d p_A = landmark->T_W_A.q.conjugate() * ldlt.solve(b);
    if (p_A.z() > 0.1 && p_A.z() < 200.0) rho = 1.0 / p_A.z();
  }
  landmark->uv_rho << bearing_A->x() / bearing_A->z(), bearing_A->y() / bearing_A->z(), rho;
  landmark->ready = true;
}

void CameraGroup::gate(Landmark* landmark, const std::vector<TimedSensorPose>& poses) const {
  // Far off now may be fine after the next step: the gate is wide, and an observation may come back.
  constexpr double kMinGate_px = 2.0;
  const TrackNoise& noise = params_.track_noise;
  const Eigen::Vector3d p_W = landmarkPoint(landmark->T_W_A, landmark->uv_rho);
  const TimeNs first = frames_[static_cast<std::size_t>(landmark->observations.front().frame)].stamp;
  for (Observation& o : landmark->observations) {
    const auto f = static_cast<std::size_t>(o.frame);
    const auto off_px = reprojection(poses[f].T_W_S, p_W, o.px, 1.0, params_.camera);
    const double drift = noise.drift_per_s * toSeconds(frames_[f].stamp - first);
    const double gate_px = 4.0 * params_.gate_sigmas * noise.sigma_px * std::sqrt(1.0 + drift);
    o.used = off_px && off_px->r.norm() < std::max(kMinGate_px, gate_px);
  }
}

/// Everything in units of the white noise; false where there is too little to place the landmark.
bool CameraGroup::view(const Landmark& landmark, const std::vector<TimedSensorPose>& poses, Views* views) const {
  const Eigen::Vector3d p_W = landmarkPoint(landmark.T_W_A, landmark.uv_rho);
  const Eigen::Matrix3d J = landmarkJacobian(landmark.T_W_A, landmark.uv_rho);
  TimeNs first = 0;
  views->clear();
  for (const Observation& o : landmark.observations) {
    if (!o.used) continue;
    const auto f = static_cast<std::size_t>(o.frame);
    const auto seen = reprojection(poses[f].T_W_S, p_W, o.px, params_.track_noise.sigma_px, params_.camera);
    if (!seen) continue;
    if (views->frames.empty()) first = frames_[f].stamp;
    views->frames.push_back(o.frame);
    views->times_s.push_back(toSeconds(frames_[f].stamp - first));
    views->places.push_back(kPlaces * f + placeOf(o.px, params_.camera));
    views->r.push_back(seen->r);
    views->J_pose.push_back(seen->J_pose);
    views->J_landmark.push_back(seen->J_point * J);
  }
  return views->frames.size() >= 2;
}

void CameraGroup::addLandmark(Landmark* landmark, Sums* sums) const {
  Views& views = sums->views;
  if (!view(*landmark, *sums->poses, &views)) return;
  weigh(&views);
  const RobustWeight robust = studentT(views.squared, views.degrees(), params_.track_freedom);
  const double repeated = weightOf(views);
  if (!eliminate(repeated * robust.weight, landmark, sums)) return;
  landmark->cost = repeated * robust.cost;
  sums->cost += landmark->cost;
  sums->track_noise.add(views.times_s, views.places, views.r, robust.weight);
  sums->track_noise.addWhitened(views.squared, expectedWeighed(views.degrees(), params_.track_freedom), robust.weight);
  const double px2 = params_.track_noise.sigma_px * params_.track_noise.sigma_px;
  for (const Eigen::Vector2d& r : views.r) sums->track_square_px += 0.5 * px2 * r.squaredNorm();
  sums->track_observations += views.r.size();
}

double CameraGroup::weightOf(const Views& views) const {
  double sum = 0.0;
  for (const int frame : views.frames) sum += *frames_[static_cast<std::size_t>(frame)].weight;
  return sum / static_cast<double>(views.frames.size());
}

void CameraGroup::weigh(Views* views) const {
  Views& v = *views;
  const std::size_t n = v.frames.size();
  v.information = params_.track_noise.information(v.times_s);
  v.weighed_J.assign(n, Eigen::Matrix<double, 2, 3>::Zero());
  v.weighed_r.assign(n, Eigen::Vector2d::Zero());
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      v.weighed_J[i].noalias() += v.at(i, j) * v.J_landmark[j];
      v.weighed_r[i].noalias() += v.at(i, j) * v.r[j];
    }
    v.squared += v.r[i].dot(v.weighed_r[i]);
  }
}

bool CameraGroup::eliminate(double weight, Landmark* landmark, Sums* sums) const {
  Landmark& l = *landmark;
  Views& v = sums->views;
  const std::size_t n = v.frames.size();
  Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
  V(2, 2) = kRegularInverseDepth;
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) {
    v.weighed_J[i] *= weight;
    v.weighed_r[i] *= weight;
    V += v.J_landmark[i].transpose().lazyProduct(v.weighed_J[i]);
    g += v.J_landmark[i].transpose().lazyProduct(v.weighed_r[i]);
  }
  const Eigen::LLT<Eigen::Matrix3d> llt(V);
  if (llt.info() != Eigen::Success) return false;
  l.eliminated = true;
  l.V_inverse = llt.solve(Eigen::Matrix3d::Identity());
  l.gradient = g;
  l.W.clear();
  v.freed_J.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    l.W.emplace_back(v.frames[i], v.J_pose[i].transpose().lazyProduct(v.weighed_J[i]));
    v.freed_J[i] = v.weighed_J[i].lazyProduct(l.V_inverse);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const auto f = static_cast<std::size_t>(v.frames[i]);
    // Between two views all goes through their two pixel coordinates: 2 x 2 before it is 6 x 6.
    const auto addPair = [&](std::size_t j, Matrix6d* H) {
      Eigen::Matrix2d K = -v.freed_J[i].lazyProduct(v.weighed_J[j].transpose());
      K.diagonal().array() += weight * v.at(i, j);
      const Eigen::Matrix<double, 6, 2> J_K = v.J_pose[i].transpose().lazyProduct(K);
      *H += J_K.lazyProduct(v.J_pose[j]);
    };
    sums->b[f] += v.J_pose[i].transpose() * (v.weighed_r[i] - v.freed_J[i] * g);
    addPair(i, &sums->H[f]);
    for (std::size_t j = i + 1; j < n; ++j) addPair(j, &sums->pairs[f].with(v.frames[j]));
  }
  return true;
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
    l.previous_cost = l.cost;
    if (!l.eliminated) continue;
    Eigen::Vector3d rhs = l.gradient;
    for (const auto& [frame, W] : l.W) rhs.noalias() += W.transpose() * moved[static_cast<std::size_t>(frame)];
    l.uv_rho -= l.V_inverse * rhs;
    l.uv_rho.z() = std::max(l.uv_rho.z(), kMinInverseDepth);
  }
}

bool CameraGroup::revertWorseLandmarks() {
  bool any = false;
  for (auto& entry : landmarks_) {
    Landmark& l = entry.second;
    if (!l.eliminated || l.cost <= l.previous_cost) continue;
    l.uv_rho = l.previous;
    any = true;
  }
  return any;
}

void CameraGroup::revertLandmarks() {
  for (auto& entry : landmarks_) entry.second.uv_rho = entry.second.previous;
}

}  // namespace cocalib
