#include "cocalib/estimation/inertial_window.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <thread>

#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

constexpr double kGaugeSigma =
    1e-4;  // position [m] and heading [rad] of the first node: fixed, nothing depends on them
constexpr double kUnknownOutline = 0.05;  // m, 1 sigma, where the rig file gives no plate size
// The biases' random walk is so small that even a millionth of its information, summed over the nodes of a window,
// outweighs what the data say about the bias: more damping than this would hold it back for many iterations.
constexpr double kFirstLambda = 1e-10, kMinLambda = 1e-12, kMaxLambda = 1e8;
constexpr double kNegligible = 1e-2;  // decrease of the cost: a seventh of a sigma of one parameter
constexpr double kInvisible = 1e-3;
constexpr double kMinKnown = 0.9;  // share of the points on planes, over what it was when the planes were found

void addDiagonalPrior(ChainSystem* system, int column, double error, double sigma) {
  const double w = 1.0 / (sigma * sigma);
  system->H_global(column, column) += w;
  system->b_global[column] += w * error;
  system->cost += 0.5 * w * error * error;
}

}  // namespace

InertialWindow::InertialWindow(const Params& params)
    : params_(params), chain_(params.imu_noise), plane_map_(params.plane_map) {
  if (params.camera) camera_.emplace(*params.camera);
  if (params.lidar) lidar_.emplace(*params.lidar);
}

void InertialWindow::reset(const NavState& first, const Calibration& calibration, double gravity) {
  state_ = WindowState();
  state_.nodes.push_back(first);
  state_.calibration = calibration;
  state_.gravity = gravity;
  const std::optional<BoardGeometry> board = params_.camera ? params_.camera->board : std::nullopt;
  if (board) {
    // The pattern is centred on the plate; a plate of unknown size is guessed one square wider all around.
    const double width = board->width_m.value_or((board->cols + 1) * board->square_m);
    const double height = board->height_m.value_or((board->rows + 1) * board->square_m);
    const double cx = 0.5 * (board->cols - 1) * board->square_m, cy = 0.5 * (board->rows - 1) * board->square_m;
    state_.outline << cx - 0.5 * width, cx + 0.5 * width, cy - 0.5 * height, cy + 0.5 * height;
  }
  origin_ = state_;
  origin_.gravity = 9.80665;
  chain_ = InertialChain(params_.imu_noise);
  if (params_.camera) camera_.emplace(*params_.camera);
  if (params_.lidar) lidar_.emplace(*params_.lidar);
  plane_map_.clear();
  prior_.reset();
  solved_.reset();
  excitation_ = LeverExcitation();
  board_known_ = false;
  linked_scans_ = scans_since_planes_ = 0;
}

void InertialWindow::addNode(const NavState& state) {
  const double spacing = toSeconds(state.stamp - state_.nodes.back().stamp);
  if (spacing < params_.max_node_spacing_s / 3.0) return;
  state_.nodes.push_back(state);
  solved_.reset();
}

void InertialWindow::extendTo(TimeNs stamp) {
  const NavState last = state_.nodes.back();
  const double span = toSeconds(stamp - last.stamp);
  if (span <= 0.0 || imu_.empty() || stamp > imu_.lastStamp() || last.stamp < imu_.firstStamp()) return;
  const int count = std::max(1, static_cast<int>(std::ceil(span / params_.max_node_spacing_s - 1e-6)));
  std::vector<ImuSample> samples = imu_.slice(last.stamp, stamp);
  if (samples.size() < 2) return;
  const Preintegration segment(std::move(samples), params_.imu_noise, last.gyro_bias, last.accel_bias);
  for (int i = 1; i <= count; ++i) {
    const TimeNs at = i == count ? stamp : last.stamp + toNs(span * i / count);
    addNode(propagate(segment, last, state_.gravity, at));
  }
}

void InertialWindow::startBoard() {
  const auto view = camera_->firstBoardView();
  if (!view) return;
  const auto T_C_B = estimateBoardPose(view->second, *params_.camera->board, params_.camera->camera);
  if (!T_C_B) return;
  const TimeNs stamp = view->first + toNs(state_.calibration.camera_time_offset_s);
  const int node = nodeAt(state_.nodes, stamp);
  const TimedPose imu =
      timedPose(chain_.segment(node), state_.nodes[static_cast<std::size_t>(node)], state_.gravity, stamp);
  state_.T_W_B = imu.T_W_I * state_.calibration.T_imu_camera * *T_C_B;
  board_known_ = true;
}

void InertialWindow::relink(Relink what, double slack_m, std::size_t points) {
  updateChain();
  solved_.reset();
  if (camera_) {
    camera_->relink(state_, chain_);
    if (!board_known_ && params_.camera->board) startBoard();
  }
  if (!lidar_ || lidar_->scans() == 0) return;
  if (what == Relink::kNewPlanes) rebuildPlanes();
  if (what != Relink::kNewScans) linked_scans_ = 0;
  lidar_->link(state_, chain_, plane_map_, linked_scans_, slack_m, board_known_, points);
  linked_scans_ = lidar_->scans();
  if (what == Relink::kNewPlanes) share_on_planes_ = lidar_->shareOnPlanes(0, linked_scans_);
}

Relink InertialWindow::neededRelink() const {
  if (!lidar_ || scans_since_planes_ == 0) return Relink::kNewScans;
  const int first_since = lidar_->scans() - scans_since_planes_;
  if (first_since <= 0) return Relink::kNewPlanes;
  const bool linked_since = linked_scans_ > first_since;
  const bool lost = linked_since && lidar_->shareOnPlanes(first_since, linked_scans_) < kMinKnown * share_on_planes_;
  return lost ? Relink::kNewPlanes : Relink::kNewScans;
}

std::size_t InertialWindow::planesInUse() const {
  if (!lidar_) return 0;
  const std::vector<bool> used = lidar_->planesInUse(state_.planes.size());
  return static_cast<std::size_t>(std::count(used.begin(), used.end(), true));
}

/// Eliminates the planes that no point in the window lies on. @return the others, under their numbers
std::vector<std::optional<Plane>> InertialWindow::retirePlanes() {
  const std::vector<bool> used = lidar_->planesInUse(state_.planes.size());
  std::vector<std::optional<Plane>> landmarks(state_.planes.size());
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (used[i]) {
      landmarks[i] = state_.planes[i];
    } else {
      prior_->forgetPlane(static_cast<int>(i));
    }
  }
  return landmarks;
}

void InertialWindow::rebuildPlanes() {
  const auto landmarks = prior_ ? retirePlanes() : std::vector<std::optional<Plane>>();
  // The first planes are those that everything starts from; later ones only join what is known.
  const std::size_t wanted = prior_ ? 400000 : 1000000;
  plane_map_.clear();
  const auto total =
      static_cast<std::size_t>(lidar_->scans()) * std::max<std::size_t>(1, lidar_->scan(0).points.size());
  lidar_->fillMap(state_, chain_, 0, static_cast<std::uint32_t>(total / wanted) + 1, &plane_map_);
  plane_map_.extract(landmarks);
  state_.planes = plane_map_.planes();
  for (std::size_t i = 0; prior_ && i < state_.planes.size(); ++i) {
    const bool is_new = i >= landmarks.size() || !landmarks[i];
    if (is_new) prior_->startPlane(static_cast<int>(i), state_.planes[i]);
  }
  scans_since_planes_ = 0;
}

/// Knowledge of what is shared, from before any data. Never part of a marginalization, so that it stays what it was.
void InertialWindow::addGlobalPriors(const WindowState& state, ChainSystem* system) const {
  using Layout = GlobalLayout;
  // Board and planes have no prior to speak of; these only keep an unseen one regular.
  for (int i = 0; i < 6; ++i) addDiagonalPrior(system, Layout::kBoard + i, 0.0, 1e3);
  for (int i = Layout::kFixed; i < system->globals(); ++i) addDiagonalPrior(system, i, 0.0, 1e3);

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

void InertialWindow::build(const WindowState& state, int end_node, ChainSystem* system) {
  const int nodes = static_cast<int>(state.nodes.size());
  ChainSystem visual(camera_ ? nodes : 0, camera_ ? GlobalLayout::kFixed : 0);
  std::thread worker;
  if (camera_) worker = std::thread([&] { camera_->accumulate(state, chain_, end_node, &visual); });
  chain_.accumulate(state, 0, end_node < 0 ? nodes - 2 : end_node - 1, system);
  if (lidar_) lidar_->accumulate(state, chain_, end_node, system);
  prior_ ? prior_->accumulate(state, system) : addFirstPrior(state, system);
  if (camera_) {
    worker.join();
    system->add(visual);
  }
  const bool lidar_board = lidar_ && lidar_->boardPoints() > 0;
  const LeverLinks links = {camera_.has_value(), lidar_.has_value(), board_known_, lidar_board};
  const UnseenLevers unseen = excitation_.unseen(state_.nodes);
  blind(unseen, links, state, system);
  if (end_node >= 0) return;
  addGlobalPriors(state, system);
  if (unseen.directions.cols() == 3) holdAccelBias(state, system);
}

InertialWindow::Summary InertialWindow::optimize(int max_iterations) {
  Summary summary;
  const int nodes = static_cast<int>(state_.nodes.size());
  const int globals = GlobalLayout::size(static_cast<int>(state_.planes.size()));
  ChainSystem system(nodes, globals);
  build(state_, -1, &system);
  solved_.reset();
  summary.first_cost = summary.last_cost = system.cost;
  double lambda = kFirstLambda;
  while (summary.iterations < max_iterations && lambda < kMaxLambda) {
    ChainSystem::Step step;
    if (!system.solve(lambda, &step)) {
      lambda = std::max(10.0 * lambda, 1e-4);
      continue;
    }
    ++summary.iterations;
    if (step.predicted_decrease < kInvisible) {  // not worth a look at what it really brings
      state_ = state_.plus(step);
      if (camera_) camera_->moveLandmarks(step);
      break;
    }
    const WindowState candidate = state_.plus(step);
    if (camera_) camera_->moveLandmarks(step);
    ChainSystem next(nodes, globals);
    build(candidate, -1, &next);
    if (!(next.cost <= system.cost * (1.0 + 1e-9))) {  // negated, so that NaN is refused too
      lambda = std::max(10.0 * lambda, 1e-4);
      if (camera_) {  // what it keeps for back-substitution must be that of the state we return to
        camera_->revertLandmarks();
        ChainSystem again(nodes, globals);
        build(state_, -1, &again);
      }
      continue;
    }
    const double decrease = system.cost - next.cost;
    state_ = candidate;
    system = std::move(next);
    lambda = std::max(0.1 * lambda, kMinLambda);
    if (decrease < kNegligible && step.predicted_decrease < kNegligible) break;
  }
  summary.last_cost = system.cost;
  summary.failed = lambda >= kMaxLambda;
  solved_ = std::move(system);
  return summary;
}

bool InertialWindow::calibrationCovariance(Matrix14d* covariance) {
  if (!solved_) {
    solved_.emplace(static_cast<int>(state_.nodes.size()), GlobalLayout::size(static_cast<int>(state_.planes.size())));
    build(state_, -1, &*solved_);
  }
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
  if (!solved_->globalInformation(&H, &b)) return false;
  const Eigen::LLT<Eigen::MatrixXd> llt(H);
  if (llt.info() != Eigen::Success) return false;
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(H.rows(), 14);
  for (int i = 0; i < 14; ++i) columns(GlobalLayout::calibrationColumn(i), i) = 1.0;
  const Eigen::MatrixXd solved = llt.solve(columns);
  for (int i = 0; i < 14; ++i) covariance->row(i) = solved.row(GlobalLayout::calibrationColumn(i));
  *covariance = (0.5 * (*covariance + covariance->transpose())).eval();
  return covariance->allFinite() && covariance->diagonal().minCoeff() > 0.0;
}

bool InertialWindow::marginalizeBefore(TimeNs stamp) {
  const int count = nodeAt(state_.nodes, stamp);
  const int nodes = static_cast<int>(state_.nodes.size());
  if (count < 1 || count + 2 > nodes) return true;
  solved_.reset();
  ChainSystem system(nodes, GlobalLayout::size(static_cast<int>(state_.planes.size())));
  build(state_, count, &system);
  ChainSystem::Marginal marginal;
  if (!system.marginalizeFront(count, &marginal)) return false;
  excitation_.remember(state_.nodes, count);
  state_.nodes.erase(state_.nodes.begin(), state_.nodes.begin() + count);
  prior_.emplace(std::move(marginal), count, state_);
  chain_.dropFront(count);
  imu_.forgetBefore(state_.nodes.front().stamp - toNs(1.0));
  if (camera_) camera_->dropFront(count);
  if (lidar_) {
    lidar_->dropFront(count, state_.nodes.front().stamp - toNs(state_.calibration.lidar_time_offset_s));
    linked_scans_ = lidar_->scans();
  }
  return true;
}

}  // namespace cocalib
