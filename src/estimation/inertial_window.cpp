#include "cocalib/estimation/inertial_window.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>

#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

// The biases' random walk is so small that even a millionth of its information, summed over the nodes of a window,
// outweighs what the data say about the bias: more damping than this would hold it back for many iterations.
constexpr double kFirstLambda = 1e-10, kMinLambda = 1e-12, kMaxLambda = 1e8;
constexpr double kNegligible = 1e-2;  // decrease of the cost: a seventh of a sigma of one parameter
constexpr double kInvisible = 1e-3;
constexpr double kWorthwhile = 1.0;  // who cannot take a step that should bring more has not solved anything
constexpr double kMinKnown = 0.9;    // share of the points on planes, over what it was when the planes were found

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
  imu_scale_ = ImuNoiseScale();
  imu_learnt_until_ = 0;
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

void InertialWindow::learnNoise() {
  learnImuNoise();                                        // first: it needs the system as it was solved
  if (camera_ && camera_->learnNoise()) solved_.reset();  // its information was that of another noise
  if (lidar_) lidar_->learnRangeNoise();
}

/// Noise hardly changes, and to measure it costs a solve: once it is settled every few seconds will do.
void InertialWindow::learnImuNoise() {
  constexpr double kPeriod_s = 3.0, kMost = 20.0, kMatters = 0.05;
  if (!solved_ || toSeconds(state_.nodes.back().stamp - imu_learnt_until_) < kPeriod_s) return;
  const auto factor = measureImuNoise(chain_, state_, *solved_);
  if (!factor) return;
  const ImuNoiseScale scale = {std::max(1.0, imu_scale_.gyro * factor->gyro),
                               std::max(1.0, imu_scale_.accel * factor->accel)};
  if (scale.gyro > kMost || scale.accel > kMost) return;  // no noise: states that contradict the data
  const auto differs = [](double a, double b) { return std::abs(a - b) > kMatters * b; };
  if (differs(scale.gyro, imu_scale_.gyro) || differs(scale.accel, imu_scale_.accel)) {
    scaleImuNoise(scale);
  } else {
    imu_learnt_until_ = state_.nodes.back().stamp;
  }
}

void InertialWindow::scaleImuNoise(const ImuNoiseScale& scale) {
  if (scale.gyro == imu_scale_.gyro && scale.accel == imu_scale_.accel) return;
  imu_scale_ = scale;
  ImuNoise noise = params_.imu_noise;
  noise.gyro_noise_density *= scale.gyro;
  noise.accel_noise_density *= scale.accel;
  chain_.setNoise(noise);
  updateChain();
  solved_.reset();
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
  const UnseenLevers unseen = excitation_.unseen(state_.nodes, chain_);
  blind(unseen, links, state, system);
  if (end_node >= 0) return;
  addGlobalPriors(state, system);
  if (unseen.directions.cols() == 3) holdAccelBias(state, system);
}

/// Goes to where a step leads, unless the cost there is more than `most`. @param next  the system there; empty at first
bool InertialWindow::take(const ChainSystem::Step& step, double most, ChainSystem* next) {
  const WindowState candidate = state_.plus(step);
  if (camera_) camera_->moveLandmarks(step);
  build(candidate, -1, next);
  const auto fits = [&] { return next->cost <= most; };  // never true of NaN
  if (!fits() && camera_ && camera_->revertWorseLandmarks()) {
    *next = ChainSystem(next->nodes(), next->globals());
    build(candidate, -1, next);
  }
  if (fits()) {
    state_ = candidate;
    return true;
  }
  if (camera_) {  // what it keeps for back-substitution must be that of the state we return to
    camera_->revertLandmarks();
    ChainSystem again(next->nodes(), next->globals());
    build(state_, -1, &again);
  }
  return false;
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
  bool taken = false;
  double refused = std::numeric_limits<double>::infinity();  // what the first step in vain was to bring
  while (summary.iterations < max_iterations && lambda < kMaxLambda) {
    ChainSystem::Step step;
    if (!system.solve(lambda, &step)) {
      lambda = std::max(10.0 * lambda, 1e-4);
      continue;
    }
    ++summary.iterations;
    if (step.predicted_decrease < kInvisible) {  // not worth a look at what it really brings
      taken = true;
      state_ = state_.plus(step);
      if (camera_) camera_->moveLandmarks(step);
      break;
    }
    ChainSystem next(nodes, globals);
    if (!take(step, system.cost * (1.0 + 1e-9), &next)) {
      lambda = std::max(10.0 * lambda, 1e-4);
      if (std::isinf(refused)) refused = step.predicted_decrease;
      continue;
    }
    taken = true;
    const double decrease = system.cost - next.cost;
    system = std::move(next);
    lambda = std::max(0.1 * lambda, kMinLambda);
    if (decrease < kNegligible && step.predicted_decrease < kNegligible) break;
  }
  summary.last_cost = system.cost;
  summary.failed = !taken && refused > kWorthwhile;
  solved_ = std::move(system);
  return summary;
}

void InertialWindow::setLinearization(const Calibration& calibration) {
  const Eigen::Matrix3Xd open = excitation_.unseen(state_.nodes, chain_).directions;
  const Calibration before = state_.calibration;
  state_.calibration = calibration;
  const auto keepOpen = [&](const Pose& own, Pose* taken) {
    taken->t += open * (open.transpose() * (own.t - taken->t));
  };
  keepOpen(before.T_imu_camera, &state_.calibration.T_imu_camera);
  keepOpen(before.T_imu_lidar, &state_.calibration.T_imu_lidar);
  solved_.reset();
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
  excitation_.remember(state_.nodes, chain_, count);
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
