#include "cocalib/monitor/imu_plausibility.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace cocalib {
namespace {

constexpr double kLeastSpanS = 2.0;
constexpr TimeNs kBlockNs = 100'000'000;
constexpr std::size_t kMostBlocks = 600;   // a minute
constexpr double kFastestSoldRadS = 80.0;  // 4000 deg/s is the widest range of any MEMS gyroscope; 70 rad/s
// A turn of gravity that the gyroscope predicts, RMS, from which the accelerometer can confirm or deny it [1/s].
constexpr double kClearTurn = 0.5;
// At the top of a swing a sensor is rarely at its very largest value, and often within this of it; one that is cut off
// is the other way round.
constexpr double kBelow = 0.02;
constexpr int kLeastAtLimit = 10, kLeastRatio = 3;
constexpr double kLeastGyroLimit = 1.0, kLeastAccelLimit = 15.0;

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[240];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void ImuPlausibility::Channel::add(double value) {
  const double magnitude = std::abs(value);
  const double tolerance = 1e-9 * largest;
  if (magnitude > largest + tolerance) {
    below += at_largest;
    if (magnitude > (1.0 + kBelow) * counted_from) {
      counted_from = magnitude;
      below = 0;
    }
    largest = magnitude;
    at_largest = 1;
  } else if (magnitude >= largest - tolerance) {
    ++at_largest;
  } else if (magnitude > (1.0 - kBelow) * largest) {
    ++below;
  }
}

bool ImuPlausibility::Channel::isSaturated(double least) const {
  return largest >= least && at_largest >= kLeastAtLimit && at_largest >= kLeastRatio * below;
}

void ImuPlausibility::add(const ImuSample& sample) {
  if (!sample.gyro.allFinite() || !sample.accel.allFinite()) return;
  if (first_ && sample.stamp <= last_) return;
  if (!first_) {
    first_ = sample.stamp;
    block_.begin = sample.stamp;
  }
  last_ = sample.stamp;
  for (Eigen::Index i = 0; i < 3; ++i) {
    channels_[static_cast<std::size_t>(i)].add(sample.gyro[i]);
    channels_[static_cast<std::size_t>(i + 3)].add(sample.accel[i]);
  }
  fastest_ = std::max(fastest_, sample.gyro.norm());
  if (sample.stamp - block_.begin >= kBlockNs) finishBlock();
  if (block_.samples == 0) block_.begin = sample.stamp;
  ++block_.samples;
  block_.gyro += sample.gyro;
  block_.accel += sample.accel;
}

/// The direction of gravity turns by d up / dt = -w x up in the IMU's frame: what the gyroscope predicts of it against
/// what the accelerometer shows of it, over three blocks. The rig's own acceleration is noise to this and averages out.
void ImuPlausibility::finishBlock() {
  const Eigen::Vector3d accel = block_.accel / block_.samples, rate = block_.gyro / block_.samples;
  block_ = Block();
  if (accel_norms_.size() < kMostBlocks) accel_norms_.push_back(accel.norm());
  recent_up_.push_back(accel.normalized());
  recent_rate_.push_back(rate);
  if (recent_up_.size() < 3) return;
  const Eigen::Vector3d predicted = recent_up_[1].cross(recent_rate_[1]);
  const Eigen::Vector3d observed = (recent_up_[2] - recent_up_[0]) / (2.0 * toSeconds(kBlockNs));
  predicted_square_ += predicted.squaredNorm();
  predicted_observed_ += predicted.dot(observed);
  ++turns_;
  recent_up_.erase(recent_up_.begin());
  recent_rate_.erase(recent_rate_.begin());
}

std::optional<Finding> ImuPlausibility::judgeAcceleration(const std::string& topic) const {
  const double size = median(accel_norms_);
  const auto fail = [&](const std::string& what, const std::string& remedy) {
    return Finding{
        "imu acceleration unit",
        format("%s: the acceleration is %.3g in the median, gravity is 9.81 m/s^2: ", topic.c_str(), size) + what,
        remedy, Finding::Weight::kError};
  };
  if (size > 0.5 && size < 2.0) return fail("it is in g", "have the driver publish m/s^2 (times 9.80665)");
  if (size > 500.0 && size < 2000.0) {
    return fail("it is in milli-g or cm/s^2", "have the driver publish m/s^2 (times 0.00980665, or 0.01)");
  }
  if (size <= 0.5) {
    return fail("gravity has been taken out of it",
                "have the driver publish the raw specific force, not the \"linear\" or \"free\" acceleration");
  }
  if (size < 7.0 || size > 13.0) return fail("its scale is wrong", "check the unit and the range set in the driver");
  return std::nullopt;
}

std::optional<Finding> ImuPlausibility::judgeRotation(const std::string& topic) const {
  const double turn = turns_ > 0 ? std::sqrt(predicted_square_ / turns_) : 0.0;
  const double agreement = predicted_square_ > 0.0 ? predicted_observed_ / predicted_square_ : 1.0;
  const bool clear = turn > kClearTurn;
  // In deg/s the gyroscope predicts 57 times the turn that the accelerometer sees.
  if (fastest_ > kFastestSoldRadS || (clear && agreement > -0.1 && agreement < 0.1)) {
    return Finding{
        "imu rotation unit",
        format("%s: the angular rate reaches %.1f, and gravity turns %.0f times slower than that says: it is "
               "in deg/s",
               topic.c_str(), fastest_, clear ? 1.0 / std::max(agreement, 0.01) : 57.3),
        "have the driver publish rad/s (times 0.0174533)", Finding::Weight::kError};
  }
  if (clear && agreement < -0.3) {
    return Finding{
        "imu axes",
        topic +
            ": gravity turns the other way than the gyroscope says: the axes of gyroscope and accelerometer "
            "do not agree",
        "check the driver's axis settings; both must be of one right-handed frame, and the accelerometer must "
        "show +9.81 on the axis that points up",
        Finding::Weight::kError};
  }
  return std::nullopt;
}

std::vector<Finding> ImuPlausibility::findings(const std::string& topic) const {
  std::vector<Finding> all;
  if (!first_ || toSeconds(last_ - *first_) < kLeastSpanS || accel_norms_.empty()) return all;
  if (const auto found = judgeAcceleration(topic)) all.push_back(*found);
  if (const auto found = judgeRotation(topic)) all.push_back(*found);
  const char* axes[] = {"x", "y", "z"};
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    const bool gyro = i < 3;
    if (!channels_[i].isSaturated(gyro ? kLeastGyroLimit : kLeastAccelLimit)) continue;
    all.push_back(
        {std::string("imu ") + (gyro ? "gyroscope" : "accelerometer") + " range",
         format("%s: the %s stands at %.4g %s on its %s axis in %d samples: it has reached the end of its range",
                topic.c_str(), gyro ? "gyroscope" : "accelerometer", channels_[i].largest, gyro ? "rad/s" : "m/s^2",
                axes[i % 3], channels_[i].at_largest),
         "set a wider range in the driver, or move more gently", Finding::Weight::kError});
  }
  return all;
}

}  // namespace cocalib
