#include "cocalib/initialization/motion_equations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "cocalib/initialization/robust.h"
#include "cocalib/initialization/rotation_search.h"

namespace cocalib {
namespace {

constexpr TimeNs kStep = 5000000;        // of the tables; motion has little above 10 Hz
constexpr double kRateSpan_s = 0.2;      // of one rate of turn
constexpr double kMaxPoseGap_s = 0.35;   // over which the orientation between two poses is interpolated
constexpr double kGravity = 9.81;        // what an error of orientation does to the specific force
constexpr double kGyroBiasPrior = 0.2;   // [rad/s]
constexpr double kAccelBiasPrior = 0.3;  // [m/s^2]
constexpr double kLeverPrior_m = 1.0;
constexpr double kCauchySigmas = 2.5;
constexpr double kSmallestShare = 0.1, kLargestShare = 10.0;  // of the stated noise, that residuals may show

constexpr int kGyroBiasColumn = 9, kAccelBiasColumn = 12, kGravityColumn = 15, kLeverColumn = 18, kOthers = 12;

/// Second difference over unevenly spaced instants: slope after the middle minus slope before it.
template <typename T>
T secondDifference(const T& before, const T& middle, const T& after, double step_before_s, double step_after_s) {
  return (after - middle) / step_after_s - (middle - before) / step_before_s;
}

}  // namespace

MotionEquations::MotionEquations(const ImuBuffer& imu, const std::vector<SensorPose>& poses, const Settings& settings)
    : poses_(poses), settings_(settings) {
  if (poses.size() < kFewest) return;
  choosePairs(imu);
  chooseTriples();
  tabulate(imu);
  equations_.resize(pairs_.size() + triples_.size());
  for (std::size_t i = 0; i < pairs_.size(); ++i) equations_[i].sigma = std::sqrt(2.0) * settings.rotation_sigma_rad;
  // Second differences around neighbouring poses share most of what disturbs them: they count as many times less as
  // they overlap.
  const double spacing_s = toSeconds(poses.back().stamp - poses.front().stamp) / static_cast<double>(poses.size() - 1);
  overlap_ = std::max(1.0, 2.0 * settings.span_s / spacing_s);
  const double span = settings.span_s;
  const double from_position = std::sqrt(6.0) * settings.position_sigma_m / span;
  const double from_rotation = kGravity * settings.rotation_sigma_rad * std::sqrt(spacing_s * span);
  for (std::size_t i = pairs_.size(); i < equations_.size(); ++i) {
    equations_[i].sigma = std::sqrt(overlap_) * std::hypot(from_position, from_rotation);
  }
}

void MotionEquations::choosePairs(const ImuBuffer& imu) {
  const TimeNs margin = toNs(settings_.max_offset_s);
  gyro_ = InertialPath::integrate(imu, poses_.front().stamp - margin, poses_.back().stamp + margin,
                                  Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  std::size_t a = 0;
  for (std::size_t b = 1; b < poses_.size(); ++b) {
    const double span = toSeconds(poses_[b].stamp - poses_[a].stamp);
    if (span < kRateSpan_s) continue;
    if (span <= 2.0 * kRateSpan_s) {
      pairs_.push_back({poses_[a].stamp, poses_[b].stamp, poses_[a].T_M_S.q.conjugate() * poses_[b].T_M_S.q});
    }
    a = b;
  }
}

void MotionEquations::chooseTriples() {
  std::vector<std::size_t> last_gap(poses_.size(), 0);  // first pose after the last gap
  for (std::size_t i = 1; i < poses_.size(); ++i) {
    const bool gap = toSeconds(poses_[i].stamp - poses_[i - 1].stamp) > kMaxPoseGap_s;
    last_gap[i] = gap ? i : last_gap[i - 1];
  }
  const TimeNs span = toNs(settings_.span_s);
  const auto stampBefore = [](const SensorPose& pose, TimeNs stamp) { return pose.stamp < stamp; };
  for (std::size_t middle = 1; middle + 1 < poses_.size(); ++middle) {
    const TimeNs stamp = poses_[middle].stamp;
    const auto before = std::lower_bound(poses_.begin(), poses_.end(), stamp - span, stampBefore) - poses_.begin();
    const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp + span, stampBefore) - poses_.begin();
    const auto first = static_cast<std::size_t>(before), last = static_cast<std::size_t>(after);
    if (last >= poses_.size() || first >= middle || poses_.front().stamp > stamp - span) continue;
    if (last_gap[last] <= first) triples_.push_back({first, middle, last});
  }
}

void MotionEquations::tabulate(const ImuBuffer& imu) {
  const TimeNs margin = toNs(settings_.max_offset_s);
  table_start_ = poses_.front().stamp - margin;
  for (TimeNs stamp = table_start_; stamp <= poses_.back().stamp + margin; stamp += kStep) {
    const auto sample = imu.at(stamp);
    force_.push_back(sample ? sample->accel : force_.empty() ? Eigen::Vector3d::Zero() : force_.back());
  }
  grid_start_ = poses_.front().stamp;
  std::size_t i = 0;
  for (TimeNs stamp = grid_start_; stamp <= poses_.back().stamp; stamp += kStep) {
    while (i + 2 < poses_.size() && poses_[i + 1].stamp <= stamp) ++i;
    const double share = toSeconds(stamp - poses_[i].stamp) / toSeconds(poses_[i + 1].stamp - poses_[i].stamp);
    R_M_S_.push_back(poses_[i].T_M_S.q.slerp(std::clamp(share, 0.0, 1.0), poses_[i + 1].T_M_S.q).toRotationMatrix());
  }
}

Eigen::Vector3d MotionEquations::forceAt(TimeNs stamp) const {
  const double place = static_cast<double>(stamp - table_start_) / static_cast<double>(kStep);
  const auto last = static_cast<double>(force_.size() - 1);
  const auto i = static_cast<std::size_t>(std::clamp(std::floor(place), 0.0, last - 1.0));
  const double share = std::clamp(place - static_cast<double>(i), 0.0, 1.0);
  return force_[i] + share * (force_[i + 1] - force_[i]);
}

std::vector<MotionEquations::Integral> MotionEquations::integrate(double offset_s) const {
  const TimeNs offset = toNs(offset_s);
  const double dt = toSeconds(kStep);
  Integral v = Integral::Zero(), p = Integral::Zero(), a = Integral::Zero();
  std::vector<Integral> at_poses;
  at_poses.reserve(poses_.size());
  for (std::size_t g = 0; g < R_M_S_.size(); ++g) {
    const TimeNs stamp = grid_start_ + static_cast<TimeNs>(g) * kStep;
    const Eigen::Vector3d force = forceAt(stamp + offset);
    Integral now;
    for (int j = 0; j < 3; ++j) now.middleCols<3>(3 * j) = force[j] * R_M_S_[g];
    now.rightCols<3>() = R_M_S_[g];
    if (g > 0) {  // acceleration linear between the nodes
      p += dt * v + dt * dt / 6.0 * (2.0 * a + now);
      v += 0.5 * dt * (a + now);
    }
    a = now;
    while (at_poses.size() < poses_.size() && poses_[at_poses.size()].stamp < stamp + kStep) {
      const double since = toSeconds(poses_[at_poses.size()].stamp - stamp);
      at_poses.push_back(p + since * v + 0.5 * since * since * a);
    }
  }
  return at_poses;
}

void MotionEquations::fillRates(double offset_s) {
  const std::vector<Eigen::Vector3d> imu_rates = meanGyroRates(*gyro_, pairs_, offset_s);
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    const double dt = toSeconds(pairs_[i].stamp_b - pairs_[i].stamp_a);
    Equation& equation = equations_[i];
    equation.known = logSo3(pairs_[i].R_a_b);
    for (int j = 0; j < 3; ++j) {
      equation.J.middleCols<3>(3 * j) = dt * imu_rates[i][j] * Eigen::Matrix3d::Identity();
    }
    equation.J.middleCols<3>(kGyroBiasColumn) = -dt * Eigen::Matrix3d::Identity();
  }
}

void MotionEquations::fillAccelerations(double offset_s) {
  const std::vector<Integral> integrals = integrate(offset_s);
  for (std::size_t i = 0; i < triples_.size(); ++i) {
    const auto& [before, middle, after] = triples_[i];
    const SensorPose &a = poses_[before], &b = poses_[middle], &c = poses_[after];
    const double step_before = toSeconds(b.stamp - a.stamp), step_after = toSeconds(c.stamp - b.stamp);
    const Integral force =
        secondDifference(integrals[before], integrals[middle], integrals[after], step_before, step_after);
    Equation& equation = equations_[pairs_.size() + i];
    equation.known = secondDifference(a.T_M_S.t, b.T_M_S.t, c.T_M_S.t, step_before, step_after);
    equation.J.leftCols<9>() = force.leftCols<9>();
    equation.J.middleCols<3>(kAccelBiasColumn) = -force.rightCols<3>();
    equation.J.middleCols<3>(kGravityColumn) = 0.5 * (step_before + step_after) * Eigen::Matrix3d::Identity();
    equation.J.middleCols<3>(kLeverColumn) =
        secondDifference(a.T_M_S.R(), b.T_M_S.R(), c.T_M_S.R(), step_before, step_after);
    equation.known = b.seen_directions * equation.known;
    equation.J = (b.seen_directions * equation.J).eval();
  }
}

RotationQuadratic MotionEquations::at(double offset_s) {
  fillRates(offset_s);
  fillAccelerations(offset_s);
  H_.setZero();
  b_.setZero();
  H_.diagonal().segment<3>(kGyroBiasColumn).setConstant(1.0 / (kGyroBiasPrior * kGyroBiasPrior));
  H_.diagonal().segment<3>(kAccelBiasColumn).setConstant(1.0 / (kAccelBiasPrior * kAccelBiasPrior));
  H_.diagonal().segment<3>(kLeverColumn).setConstant(1.0 / (kLeverPrior_m * kLeverPrior_m));
  double squares = 0.0;
  for (const Equation& equation : equations_) {
    const double w = equation.weight / (equation.sigma * equation.sigma);
    H_.noalias() += w * equation.J.transpose() * equation.J;
    b_.noalias() += w * equation.J.transpose() * equation.known;
    squares += w * equation.known.squaredNorm();
  }
  const Eigen::LDLT<Eigen::Matrix<double, kOthers, kOthers>> others(H_.bottomRightCorner<kOthers, kOthers>());
  const Eigen::Matrix<double, kOthers, 9> cross = H_.bottomLeftCorner<kOthers, 9>();
  const Eigen::Matrix<double, kOthers, 1> rest = b_.tail<kOthers>();
  RotationQuadratic result;
  result.Q = H_.topLeftCorner<9, 9>() - cross.transpose() * others.solve(cross);
  result.q = b_.head<9>() - cross.transpose() * others.solve(rest);
  result.c = squares - rest.dot(others.solve(rest));
  return result;
}

MotionEquations::Unknowns MotionEquations::solutionFor(const Eigen::Matrix3d& R_sensor_imu) const {
  Unknowns solution;
  solution.head<9>() = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(R_sensor_imu.data());
  const Eigen::LDLT<Eigen::Matrix<double, kOthers, kOthers>> others(H_.bottomRightCorner<kOthers, kOthers>());
  solution.tail<kOthers>() = others.solve(b_.tail<kOthers>() - H_.bottomLeftCorner<kOthers, 9>() * solution.head<9>());
  return solution;
}

std::vector<double> MotionEquations::residualLengths(std::size_t begin, std::size_t end,
                                                     const Unknowns& solution) const {
  std::vector<double> lengths;
  for (std::size_t i = begin; i < end; ++i)
    lengths.push_back((equations_[i].known - equations_[i].J * solution).norm());
  return lengths;
}

void MotionEquations::reweight(std::size_t begin, std::size_t end, const Unknowns& solution) {
  const std::vector<double> lengths = residualLengths(begin, end, solution);
  const double sigma = equations_[begin].sigma;
  // Overlap is part of the accelerations' sigma; what their residuals show does not contain it.
  const double repeats = begin == 0 ? 1.0 : overlap_;
  const double shown = std::sqrt(repeats) * medianOf(lengths) / kMedianLength3;
  const double learnt = std::clamp(shown, kSmallestShare * sigma, kLargestShare * sigma);
  for (std::size_t i = begin; i < end; ++i) {
    equations_[i].sigma = learnt;
    equations_[i].weight = cauchyWeight(lengths[i - begin] * std::sqrt(repeats), kCauchySigmas * learnt);
  }
}

void MotionEquations::reweight(const Eigen::Matrix3d& R_sensor_imu) {
  const Unknowns solution = solutionFor(R_sensor_imu);
  reweight(0, pairs_.size(), solution);
  reweight(pairs_.size(), equations_.size(), solution);
}

double MotionEquations::unexplained(const Eigen::Matrix3d& R_sensor_imu) const {
  const double residual = medianOf(residualLengths(pairs_.size(), equations_.size(), solutionFor(R_sensor_imu)));
  const double whole = medianOf(residualLengths(pairs_.size(), equations_.size(), Unknowns::Zero()));
  return residual / std::max(whole, 1e-9);
}

Eigen::Vector3d MotionEquations::gyroBias(const Eigen::Matrix3d& R_sensor_imu) const {
  return R_sensor_imu.transpose() * solutionFor(R_sensor_imu).segment<3>(kGyroBiasColumn);
}

}  // namespace cocalib
