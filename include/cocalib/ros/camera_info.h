#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <optional>
#include <string>

#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Camera model of a CameraInfo: plumb_bob, rational_polynomial, equidistant or fisheye, for the raw picture as it is
/// published: binning and a region of interest are applied to the intrinsics, K itself describes the full sensor.
///
/// @param problem  set, in one line, when nothing is returned: not calibrated (K all zero), unknown model, wrong number
///                 of coefficients, impossible size. May be null. Never throws on bad data. Safe from any thread.
std::optional<CameraModel> readCameraInfo(const sensor_msgs::CameraInfo& msg, std::string* problem);

}  // namespace cocalib
