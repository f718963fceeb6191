#pragma once

#include <sensor_msgs/Imu.h>

#include <optional>
#include <string>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Inertial sample of a message; orientation and covariances are not used.
///
/// @param problem  set, in one line, when nothing is returned: values that are not finite, no stamp, or a message that
///                 says (covariance[0] == -1) that it carries no rate or no acceleration. May be null. Never throws.
///                 Safe from any thread.
std::optional<ImuSample> readImu(const sensor_msgs::Imu& msg, std::string* problem);

}  // namespace cocalib
