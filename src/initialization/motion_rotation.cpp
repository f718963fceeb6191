#include "cocalib/initialization/motion_rotation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "cocalib/initialization/motion_equations.h"

namespace cocalib {
namespace {

constexpr double kSpans_s[] = {0.4, 0.8, 1.6};  // lively motion shows in short ones, slow motion in long ones
constexpr double kOffsetStep_s = 0.01;
constexpr double kFineStep_s = 0.001;
constexpr int kRounds = 2;
constexpr double kMaxRotationSigma_rad = 0.04;
constexpr double kMinGain = 20.0;        // twice the log-likelihood by which the best must beat another
constexpr double kMaxUnexplained = 0.6;  // of the accelerations
constexpr double kShortest_s = 3.0;

std::string text(const char* format, double value) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, value);
  return buffer.data();
}

/// Poses around which the IMU covers every offset of the search.
std::vector<SensorPose> coveredPoses(const ImuBuffer& imu, const std::vector<SensorPose>& poses, double max_offset_s) {
  constexpr double kMaxImuGap_s = 0.05;
  const TimeNs margin = toNs(max_offset_s) + toNs(0.01);
  std::vector<SensorPose> covered;
  for (const SensorPose& pose : poses) {
    const bool finite = pose.T_M_S.t.allFinite() && pose.T_M_S.q.coeffs().allFinite();
    const bool rises = covered.empty() || pose.stamp > covered.back().stamp;
    if (finite && rises && imu.longestGap(pose.stamp - margin, pose.stamp + margin) <= kMaxImuGap_s) {
      covered.push_back(pose);
    }
  }
  return covered;
}

/// The best rotation over the clock offset.
struct Fit {
  double offset_s = 0.0;
  RotationMinima minima;
  std::optional<double> other_offset_cost;  ///< of the best offset in another valley
  double gain_over_zero = 0.0;              ///< by which the offset beats none at all
  double unexplained = 1.0;
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();

  /// Variances about the IMU's axes; huge where the curvature is not positive.
  Eigen::Matrix3d covariance() const {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(minima.curvature);
    const Eigen::Vector3d variances = eigen.eigenvalues().cwiseMax(1e-3).cwiseInverse();
    const Eigen::Matrix3d axes = minima.R.transpose() * eigen.eigenvectors();
    return axes * variances.asDiagonal() * axes.transpose();
  }
};

/// Cost over the offset, and where it is least.
void searchOffset(MotionEquations& equations, double max_offset_s, Fit* fit) {
  const int steps = static_cast<int>(std::ceil(max_offset_s / kOffsetStep_s));
  std::vector<double> costs;
  for (int i = -steps; i <= steps; ++i) costs.push_back(minimizeOverRotations(equations.at(i * kOffsetStep_s)).cost);
  const auto best = static_cast<int>(std::min_element(costs.begin(), costs.end()) - costs.begin());
  fit->gain_over_zero = costs[static_cast<std::size_t>(steps)] - costs[static_cast<std::size_t>(best)];
  fit->other_offset_cost.reset();
  for (const int direction : {-1, 1}) {  // over the ridge on either side
    double ridge = costs[static_cast<std::size_t>(best)];
    for (int i = best; i >= 0 && i < static_cast<int>(costs.size()); i += direction) {
      const double cost = costs[static_cast<std::size_t>(i)];
      ridge = std::max(ridge, cost);
      if (cost > ridge - 0.5 * kMinGain) continue;
      fit->other_offset_cost = std::min(fit->other_offset_cost.value_or(cost), cost);
    }
  }
  fit->offset_s = (best - steps) * kOffsetStep_s;
  double least = costs[static_cast<std::size_t>(best)];
  for (int i = -9; i <= 9; ++i) {
    const double offset_s = (best - steps) * kOffsetStep_s + i * kFineStep_s;
    const double cost = minimizeOverRotations(equations.at(offset_s)).cost;
    if (cost >= least) continue;
    least = cost;
    fit->offset_s = offset_s;
  }
}

std::optional<Fit> fitMotion(const ImuBuffer& imu, const std::vector<SensorPose>& poses, double span_s,
                             double position_sigma_m, double max_offset_s) {
  MotionEquations::Settings settings;
  settings.span_s = span_s;
  settings.max_offset_s = max_offset_s;
  settings.position_sigma_m = position_sigma_m;
  MotionEquations equations(imu, poses, settings);
  if (equations.empty()) return std::nullopt;
  Fit fit;
  for (int round = 0; round < kRounds; ++round) {
    searchOffset(equations, max_offset_s, &fit);
    if (fit.gain_over_zero < kMinGain) {  // nothing tells: the clocks are taken as they are
      fit.offset_s = 0.0;
      fit.other_offset_cost.reset();
    }
    fit.minima = minimizeOverRotations(equations.at(fit.offset_s));
    fit.unexplained = equations.unexplained(fit.minima.R);
    fit.gyro_bias = equations.gyroBias(fit.minima.R);
    equations.reweight(fit.minima.R);
  }
  return fit;
}

double worstVariance(const Fit& fit) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(fit.covariance(), Eigen::EigenvaluesOnly).eigenvalues()[2];
}

/// What speaks against a fit; empty if nothing.
std::string doubt(const Fit& fit, double max_offset_s) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(fit.covariance());
  const double sigma = std::sqrt(eigen.eigenvalues()[2]);
  if (sigma > kMaxRotationSigma_rad) {
    int axis = 0;
    eigen.eigenvectors().col(2).cwiseAbs().maxCoeff(&axis);
    return std::string("rotation about imu ") + "xyz"[axis] + " does not show yet: rotate about imu " + "yzx"[axis] +
           " or " + "zxy"[axis] + ", or speed up and slow down along them";
  }
  if (fit.unexplained > kMaxUnexplained) {
    return text("accelerations of sensor and imu do not agree (%.0f %% unexplained): check topics, stamps and units",
                100.0 * fit.unexplained);
  }
  if (fit.minima.runner_up && *fit.minima.runner_up - fit.minima.cost < kMinGain) {
    return "two mountings fit the motion alike: rotate about a second axis";
  }
  if (fit.other_offset_cost && *fit.other_offset_cost - fit.minima.cost < kMinGain) {
    return "the clock offset is not distinct: vary the speed, without a steady rhythm";
  }
  if (std::abs(fit.offset_s) > max_offset_s - kOffsetStep_s) {
    return text("the clock offset lies at the limit of the search (%.3f s): check the stamps", fit.offset_s);
  }
  return {};
}

}  // namespace

std::optional<RotationInitialization> rotationFromMotion(const ImuBuffer& imu, const std::vector<SensorPose>& poses,
                                                         double position_sigma_m,
                                                         const RotationInitializerParams& params, std::string* reason) {
  const auto refuse = [reason](const std::string& why) {
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  };
  const std::vector<SensorPose> covered = coveredPoses(imu, poses, params.max_time_offset_s);
  if (static_cast<int>(covered.size()) < params.min_pairs ||
      toSeconds(covered.back().stamp - covered.front().stamp) < kShortest_s) {
    return refuse(text("only %.0f poses of the sensor so far: keep moving", double(covered.size())));
  }
  std::optional<Fit> best;
  for (const double span_s : kSpans_s) {
    auto fit = fitMotion(imu, covered, span_s, position_sigma_m, params.max_time_offset_s);
    if (fit && (!best || worstVariance(*fit) < worstVariance(*best))) best = std::move(fit);
  }
  if (!best) return refuse("the sensor's poses have too many gaps: move more slowly");
  if (const std::string why = doubt(*best, params.max_time_offset_s); !why.empty()) return refuse(why);

  RotationInitialization result;
  result.R_imu_sensor = Eigen::Quaterniond(Eigen::Matrix3d(best->minima.R.transpose()));
  result.time_offset_s = best->offset_s;
  result.gyro_bias = best->gyro_bias;
  result.rotation_sigma_rad = std::sqrt(worstVariance(*best));
  return result;
}

}  // namespace cocalib
