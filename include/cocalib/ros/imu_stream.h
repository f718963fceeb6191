#pragma once

#include <sensor_msgs/Imu.h>

#include <optional>
#include <string>

#include "cocalib/measurements/validity.h"
#include "cocalib/ros/notices.h"
#include "cocalib/ros/stream_guard.h"

namespace cocalib {

/// The inertial messages on their way to a calibrator: refuses what is broken, drops what is out of order or repeats
/// the same numbers while the rig turns, notices a clock that was set back, and tells whether other data belong to the
/// same run. Not thread-safe.
class ImuStream {
 public:
  struct Outcome {
    std::optional<ImuSample> sample;
    bool restart = false;  ///< the clock was set back: everything must start over, with this sample as the first
  };
  /// What was refused is counted and said in `notices`.
  Outcome take(const sensor_msgs::Imu& msg, Notices* notices);

  /// Whether data of this time belong to the present run.
  bool accepts(TimeNs stamp) const { return guard_.accepts(stamp); }
  /// As accepts(); data that do not are counted as "`what` out of time", and the user told what that means.
  bool accepts(TimeNs stamp, const std::string& topic, const std::string& what, Notices* notices) const;

  void reset() {
    guard_.reset();
    stuck_.reset();
  }

 private:
  StreamGuard guard_;
  StuckImu stuck_;
};

}  // namespace cocalib
