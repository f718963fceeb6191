#include "cocalib/ros/imu_stream.h"

#include "cocalib/ros/imu_reader.h"

namespace cocalib {

ImuStream::Outcome ImuStream::take(const sensor_msgs::Imu& msg, Notices* notices) {
  notices->count("imu samples");
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
      stuck_.reset();
      break;
    case StreamGuard::Verdict::kGood:
      break;
  }
  // What is dropped leaves a gap, which the calibrators know how to take.
  if (outcome.sample && stuck_.take(*outcome.sample)) {
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
