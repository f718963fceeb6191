#include "cocalib/ros/imu_stream.h"

#include "cocalib/ros/imu_reader.h"

namespace cocalib {
namespace {

// Drivers that publish faster than the sensor measures repeat themselves for less time than this.
constexpr double kStuck_s = 0.05;
// At rest a simulated IMU without noise rightly says the same for long; one that turns feels gravity turn [rad/s].
constexpr double kTurning = 0.1;

}  // namespace

/// Whether it repeats numbers that cannot last. What is dropped leaves a gap, which the calibrators know how to take.
bool ImuStream::isStuck(const ImuSample& sample) {
  const bool same = same_since_ && sample.gyro == same_since_->gyro && sample.accel == same_since_->accel;
  if (!same) same_since_ = sample;
  return sample.gyro.norm() > kTurning && toSeconds(sample.stamp - same_since_->stamp) > kStuck_s;
}

ImuStream::Outcome ImuStream::take(const sensor_msgs::Imu& msg, Notices* notices) {
  std::string problem;
  Outcome outcome;
  outcome.sample = readImu(msg, &problem);
  if (!outcome.sample) {
    notices->count("imu samples refused");
    notices->warn("imu: " + problem);
    return outcome;
  }
  switch (guard_.onImu(outcome.sample->stamp)) {
    case StreamGuard::Verdict::kDrop:
      notices->count("imu samples out of order");
      outcome.sample.reset();
      break;
    case StreamGuard::Verdict::kRestart:
      notices->count("restarts");
      outcome.restart = true;
      same_since_.reset();
      break;
    case StreamGuard::Verdict::kGood:
      break;
  }
  if (outcome.sample && isStuck(*outcome.sample)) {
    notices->count("imu samples stuck");
    notices->warn("imu: the same numbers again and again while it turns: the sensor or its driver is stuck");
    outcome.sample.reset();
  }
  return outcome;
}

bool ImuStream::accepts(TimeNs stamp, const std::string& topic, const std::string& what, Notices* notices) const {
  if (guard_.accepts(stamp)) return true;
  notices->count(what + " out of time");
  notices->warn(topic + ": stamps are seconds away from those of the IMU; are the clocks synchronised?");
  return false;
}

}  // namespace cocalib
