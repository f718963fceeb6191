#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <optional>
#include <string>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Picture as 8-bit grey: mono8, mono16 (upper byte), rgb8, bgr8, rgba8, bgra8, bayer (8 and 16 bit), yuv422.
/// A mono8 picture whose rows are packed is copied once, nothing else.
///
/// @param problem  set, in one line, when nothing is returned: unknown encoding, sizes that contradict each other, no
///                 stamp. May be null. Never throws on bad data. Safe from any thread.
std::optional<ImageFrame> readImage(const sensor_msgs::Image& msg, std::string* problem);

/// Same for jpeg and png; what it says about its format is ignored, the bytes decide.
std::optional<ImageFrame> readImage(const sensor_msgs::CompressedImage& msg, std::string* problem);

}  // namespace cocalib
