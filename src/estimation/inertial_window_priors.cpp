// What an InertialWindow knows before any data.
#include <Eigen/Cholesky>

#include "cocalib/estimation/inertial_window.h"

namespace cocalib {
namespace {

// Position [m] and heading [rad] of the first node: fixed, nothing depends on them.
constexpr double kGaugeSigma = 1e-4;
constexpr double kUnseen = 1e3;  // m and rad
// rad. Points on one line, or all in one spot, leave a plane's tilt open, and rounding alone would turn such a plane by
// thousands of radians: one of them made every step of the whole window fail.
constexpr double kPlaneTurn = 0.1;
constexpr double kUnknownOutline = 0.05;  // m, 1 sigma, where the rig file gives no plate size

void addDiagonalPrior(ChainSystem* system, int column, double error, double sigma) {
  const double w = 1.0 / (sigma * sigma);
  system->H_global(column, column) += w;
  system->b_global[column] += w * error;
  system->cost += 0.5 * w * error * error;
}

}  // namespace

/// Knowledge of what is shared, from before any data. Never part of a marginalization, so that it stays what it was.
void InertialWindow::addGlobalPriors(const WindowState& state, ChainSystem* system) const {
  using Layout = GlobalLayout;
  // Board and planes have no prior to speak of; these only keep an unseen one regular, and pull nowhere.
  for (int i = 0; i < 6; ++i) addDiagonalPrior(system, Layout::kBoard + i, 0.0, kUnseen);
  for (int i = Layout::kFixed; i < system->globals(); ++i) addDiagonalPrior(system, i, 0.0, kUnseen);
  for (std::size_t i = 0; i < state.planes.size(); ++i) {
    system->global_damping.segment<2>(Layout::plane(static_cast<int>(i))).setConstant(1.0 / (kPlaneTurn * kPlaneTurn));
  }
  holdUnmeasuredWay(system);

  const WindowPriors& prior = params_.priors;
  const Eigen::VectorXd d = globalMinus(state, origin_);
  addDiagonalPrior(system, Layout::kGravity, d[Layout::kGravity], prior.gravity);
  if (calibration_prior_) addCalibrationPrior(state, system);
  for (const int block : {Layout::kCamera, Layout::kLidar}) {
    if (calibration_prior_) break;
    const double translation_m = block == Layout::kCamera ? prior.camera_translation_m : prior.lidar_translation_m;
    for (int i = 0; i < 3; ++i) {
      addDiagonalPrior(system, block + i, d[block + i], translation_m);
      addDiagonalPrior(system, block + 3 + i, d[block + 3 + i], prior.extrinsic_rotation_rad);
    }
    addDiagonalPrior(system, block + 6, d[block + 6], prior.time_offset_s);
  }
  const bool plate_given =
      params_.camera && params_.camera->board && params_.camera->board->width_m && params_.camera->board->height_m;
  for (int i = 0; i < 4; ++i) {
    addDiagonalPrior(system, Layout::kOutline + i, d[Layout::kOutline + i],
                     plate_given ? prior.outline_m : kUnknownOutline);
  }
}

/// Along a corridor, or before a single wall, nothing measures the way, and so neither a tilt of the world with which
/// the rig would be speeding up along it. Left alone that tilt swings by degrees from solve to solve, which the
/// marginalized prior does not survive, and rounding makes the information indefinite. Both hold without pulling
/// anywhere: steps of all nodes are damped, and the newest node is near where it is believed to be.
void InertialWindow::holdUnmeasuredWay(ChainSystem* system) {
  constexpr double kSpeedStep = 1.0;                             // [m/s]
  constexpr double kNewestPosition = 10.0, kNewestSpeed = 10.0;  // [m, m/s]
  system->node_damping.segment<3>(6).setConstant(1.0 / (kSpeedStep * kSpeedStep));
  Matrix15d& newest = system->diagonal(system->nodes() - 1);
  newest.diagonal().head<3>().array() += 1.0 / (kNewestPosition * kNewestPosition);
  newest.diagonal().segment<3>(6).array() += 1.0 / (kNewestSpeed * kNewestSpeed);
}

/// The first node's prior; it goes into the first marginalization.
void InertialWindow::addFirstPrior(const WindowState& state, ChainSystem* system) const {
  const WindowPriors& prior = params_.priors;
  Vector15d sigma;
  sigma << Eigen::Vector3d::Constant(kGaugeSigma), 10.0, 10.0, kGaugeSigma, Eigen::Vector3d::Constant(100.0),
      Eigen::Vector3d::Constant(prior.gyro_bias), Eigen::Vector3d::Constant(prior.accel_bias);
  NavState centre = origin_.nodes.front();
  centre.gyro_bias.setZero();
  centre.accel_bias.setZero();
  const Vector15d w = sigma.array().square().inverse();
  const Vector15d error = minus(state.nodes.front(), centre);
  system->diagonal(0).diagonal() += w;
  system->gradient(0) += w.cwiseProduct(error);
  system->cost += 0.5 * error.dot(w.cwiseProduct(error));
}

/// While the rig has not turned, nothing tells the accelerometer's bias from a tilt of the world and from gravity. The
/// marginalized prior, linearized at other tilts, takes such a tilt for something that it knows, and the estimate runs
/// away along it. So the bias stays where it started: any other explains the data as well. Never part of a
/// marginalization, so that nothing of it is left once the rig turns.
void InertialWindow::holdAccelBias(const WindowState& state, ChainSystem* system) const {
  constexpr double kHeld = 1e-3;  // [m/s^2]
  const int newest = static_cast<int>(state.nodes.size()) - 1;
  const Eigen::Vector3d error = state.nodes.back().accel_bias - origin_.nodes.front().accel_bias;
  const double w = 1.0 / (kHeld * kHeld);
  system->diagonal(newest).diagonal().tail<3>().array() += w;
  system->gradient(newest).tail<3>() += w * error;
  system->cost += 0.5 * w * error.squaredNorm();
}

void InertialWindow::setCalibrationPrior(const std::optional<CalibrationPrior>& prior) {
  calibration_prior_ = prior;
  if (prior) prior_information_ = prior->covariance.llt().solve(Matrix14d::Identity());
}

void InertialWindow::addCalibrationPrior(const WindowState& state, ChainSystem* system) const {
  const Calibration &now = state.calibration, &mean = calibration_prior_->mean;
  Vector14d error;
  error << now.T_imu_camera.minus(mean.T_imu_camera), now.T_imu_lidar.minus(mean.T_imu_lidar),
      now.camera_time_offset_s - mean.camera_time_offset_s, now.lidar_time_offset_s - mean.lidar_time_offset_s;
  const Vector14d gradient = prior_information_ * error;
  for (int i = 0; i < 14; ++i) {
    const int row = GlobalLayout::calibrationColumn(i);
    system->b_global[row] += gradient[i];
    for (int j = 0; j < 14; ++j) system->H_global(row, GlobalLayout::calibrationColumn(j)) += prior_information_(i, j);
  }
  system->cost += 0.5 * error.dot(gradient);
}

}  // namespace cocalib
