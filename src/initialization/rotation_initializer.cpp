#include "cocalib/initialization/rotation_initializer.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "cocalib/initialization/inertial_path.h"
#include "cocalib/initialization/rotation_search.h"

namespace cocalib {
namespace {

constexpr double kMaxImuGap_s = 0.05;    // 50 Hz, the slowest IMU that is accepted, misses one sample
constexpr double kMinRateSpread = 0.05;  // [rad/s]: below, noise of the sensor's rotations hides the motion
constexpr double kFastRate = 0.3;        // [rad/s]: turning, though evenly
constexpr double kMaxRotationSigma_rad = 0.02;
constexpr double kMaxOffsetSigma_s = 0.015;
constexpr double kMinLogLikelihood = 10.0;  // by which the best offset must beat another valley
constexpr double kMaxUnexplained = 0.6;     // of the gyro's own variation

std::string text(const char* format, double value) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, value);
  return buffer.data();
}

/// Pairs that are sane and whose interval the IMU covers, without a gap, at every offset of the search.
std::vector<RelativeSensorRotation> usablePairs(const ImuBuffer& imu,
                                                const std::vector<RelativeSensorRotation>& rotations,
                                                double max_time_offset_s) {
  const TimeNs margin = toNs(max_time_offset_s) + toNs(0.01);
  std::vector<RelativeSensorRotation> usable;
  for (const RelativeSensorRotation& pair : rotations) {
    if (pair.stamp_b <= pair.stamp_a || !pair.R_a_b.coeffs().allFinite() || pair.R_a_b.norm() < 0.5) continue;
    if (imu.longestGap(pair.stamp_a - margin, pair.stamp_b + margin) > kMaxImuGap_s) continue;
    usable.push_back(pair);
  }
  return usable;
}

/// How the IMU turned: spread of its rates about their mean, by principal axes.
struct RateSpread {
  Eigen::Vector3d mean;
  double rms = 0.0;              ///< about the mean [rad/s]
  double second_singular = 0.0;  ///< of the normalised scatter: 0 one axis only, 0.58 all alike
  Eigen::Vector3d main_axis;     ///< in the IMU frame
};

RateSpread rateSpread(const std::vector<Eigen::Vector3d>& rates) {
  RateSpread spread;
  spread.mean.setZero();
  for (const Eigen::Vector3d& rate : rates) spread.mean += rate / static_cast<double>(rates.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& rate : rates) scatter += (rate - spread.mean) * (rate - spread.mean).transpose();
  scatter /= static_cast<double>(rates.size());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
  spread.rms = std::sqrt(scatter.trace());
  spread.second_singular = std::sqrt(std::max(0.0, eigen.eigenvalues()[1]) / std::max(scatter.trace(), 1e-12));
  spread.main_axis = eigen.eigenvectors().col(2);
  return spread;
}

std::string axisName(const Eigen::Vector3d& axis) {
  int nearest = 0;
  axis.cwiseAbs().maxCoeff(&nearest);
  constexpr double kClose = 0.9;  // within 26 degrees
  if (std::abs(axis[nearest]) > kClose) return std::string("imu ") + "xyz"[nearest];
  std::array<char, 96> buffer{};
  std::snprintf(buffer.data(), buffer.size(), "(%.1f, %.1f, %.1f) in the imu frame", axis.x(), axis.y(), axis.z());
  return buffer.data();
}

/// What the motion lacks, judged from the gyro alone; empty if nothing.
std::string missingMotion(const RateSpread& spread, const RotationInitializerParams& params) {
  if (spread.rms < kMinRateSpread) {
    if (spread.mean.norm() > kFastRate) {
      return "the rotation rate is constant, which leaves the clock offset unknown: vary the speed and the axis of "
             "rotation";
    }
    return text("the rig hardly turns (%.3f rad/s): rotate it back and forth about at least two axes", spread.rms);
  }
  if (spread.second_singular < params.min_singular_value) {
    return "all rotations share one axis, " + axisName(spread.main_axis) + ": rotate about a second axis too";
  }
  return {};
}

/// What speaks against the search's result; empty if nothing.
std::string searchDoubt(const RotationSearch& search, const std::vector<RelativeSensorRotation>& pairs,
                        const RateSpread& spread) {
  double mean_duration = 0.0;
  for (const auto& pair : pairs) mean_duration += toSeconds(pair.stamp_b - pair.stamp_a) / double(pairs.size());
  if (search.best.residual_rad > kMaxUnexplained * spread.rms * mean_duration) {
    return text(
        "rotations of sensor and gyro do not agree at any clock offset (median difference %.4f rad): "
        "check topics and stamps, and move so that the sensor tracks well",
        search.best.residual_rad);
  }
  if (search.runner_up_residual_rad) {
    const double gain = static_cast<double>(pairs.size()) *
                        std::log(*search.runner_up_residual_rad / std::max(search.best.residual_rad, 1e-9));
    if (gain < kMinLogLikelihood) {
      return "the clock offset is not distinct: vary the speed of rotation, without a steady rhythm";
    }
  }
  return {};
}

/// What speaks against the refined result; empty if nothing.
std::string resultDoubt(const RotationInitialization& result, const RotationInitializerParams& params) {
  if (!result.gyro_bias.allFinite() || !std::isfinite(result.time_offset_s)) return "the rotations are inconsistent";
  if (std::abs(result.time_offset_s) > params.max_time_offset_s) {
    return text("the clock offset lies at the limit of the search (%.3f s): check the stamps, or widen max_time_offset",
                result.time_offset_s);
  }
  if (result.rotation_sigma_rad > kMaxRotationSigma_rad) {
    return text("the mounting rotation is known to %.3f rad only: rotate more, about two axes",
                result.rotation_sigma_rad);
  }
  if (result.time_offset_sigma_s > kMaxOffsetSigma_s) {
    return text("the clock offset is known to %.3f s only: vary the speed of rotation", result.time_offset_sigma_s);
  }
  if (result.median_residual_rad > params.max_residual_rad) {
    return text("the sensor's rotations fit the gyro badly (median %.4f rad): move more slowly, keep structure in view",
                result.median_residual_rad);
  }
  return {};
}

/// The sensor's rotations, and what the gyro did meanwhile.
struct Turning {
  std::vector<RelativeSensorRotation> pairs;  ///< the usable ones
  InertialPath gyro;                          ///< without bias, over the whole search range
  RateSpread spread;
};

std::optional<Turning> observeTurning(const ImuBuffer& imu, const std::vector<RelativeSensorRotation>& rotations,
                                      const RotationInitializerParams& params, std::string* why) {
  auto pairs = usablePairs(imu, rotations, params.max_time_offset_s);
  if (static_cast<int>(pairs.size()) < std::max(params.min_pairs, 3)) {
    *why = static_cast<int>(rotations.size()) < std::max(params.min_pairs, 3)
               ? text("only %.0f rotations of the sensor so far: keep moving", double(rotations.size()))
               : text("the imu covers only %.0f of the sensor's rotations: check its rate, and the clocks of both",
                      double(pairs.size()));
    return std::nullopt;
  }
  TimeNs first = pairs.front().stamp_a, last = pairs.front().stamp_b;
  for (const RelativeSensorRotation& pair : pairs) {
    first = std::min(first, pair.stamp_a);
    last = std::max(last, pair.stamp_b);
  }
  const TimeNs margin = toNs(params.max_time_offset_s);
  auto gyro =
      InertialPath::integrate(imu, first - margin, last + margin, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  if (!gyro) {
    *why = "the imu does not cover the sensor's rotations: check the clocks of both";
    return std::nullopt;
  }
  const RateSpread spread = rateSpread(meanGyroRates(*gyro, pairs, 0.0));
  return Turning{std::move(pairs), std::move(*gyro), spread};
}

/// The turning and the rotation and clock that explain it best; nothing, and why, if none is beyond doubt.
struct FoundRotation {
  Turning turning;
  RotationSearch search;
};

std::optional<FoundRotation> findRotation(const ImuBuffer& imu, const std::vector<RelativeSensorRotation>& rotations,
                                          const RotationInitializerParams& params, std::string* why) {
  auto turning = observeTurning(imu, rotations, params, why);
  if (!turning) return std::nullopt;
  if (*why = missingMotion(turning->spread, params); !why->empty()) return std::nullopt;
  RotationSearch search = searchRotation(turning->gyro, turning->pairs, params.max_time_offset_s);
  if (*why = searchDoubt(search, turning->pairs, turning->spread); !why->empty()) return std::nullopt;
  return FoundRotation{std::move(*turning), std::move(search)};
}

}  // namespace

std::optional<RotationInitialization> initializeRotation(const ImuBuffer& imu,
                                                         const std::vector<RelativeSensorRotation>& rotations,
                                                         const RotationInitializerParams& params, std::string* reason) {
  std::string why;
  const auto refuse = [reason, &why] {
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  };
  const auto found = findRotation(imu, rotations, params, &why);
  if (!found) return refuse();
  auto result = refineRotation(imu, found->turning.pairs, found->search.best);
  if (!result) {
    why = "the imu does not cover the sensor's rotations: check the clocks of both";
    return refuse();
  }
  result->second_singular_value = found->turning.spread.second_singular;
  if (why = resultDoubt(*result, params); !why.empty()) return refuse();
  return result;
}

std::optional<AxisRotation> rotationAboutOneAxis(const ImuBuffer& imu,
                                                 const std::vector<RelativeSensorRotation>& rotations,
                                                 const RotationInitializerParams& params, std::string* reason) {
  RotationInitializerParams one_axis = params;
  one_axis.min_singular_value = 0.0;
  std::string why;
  const auto found = findRotation(imu, rotations, one_axis, &why);
  if (!found) {
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  }
  const RateSpread& spread = found->turning.spread;
  const auto& best = found->search.best;
  AxisRotation result;
  result.axis_imu = spread.main_axis;
  result.rotation.R_imu_sensor = best.R_imu_sensor;
  result.rotation.time_offset_s = best.time_offset_s;
  result.rotation.gyro_bias = best.gyro_bias;
  result.rotation.median_residual_rad = best.residual_rad;
  result.rotation.second_singular_value = spread.second_singular;
  return result;
}

}  // namespace cocalib
