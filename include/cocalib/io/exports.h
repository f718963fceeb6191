#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/io/rig_config.h"

namespace cocalib {

/// A file by its name and what it holds.
struct NamedText {
  std::string name;
  std::string text;
};

/// The calibration as other programs read it: Kalibr, OpenVINS, VINS-Mono, LVI-SAM, LIO-SAM, FAST-LIO, URDF and a
/// launch file of static transforms. Each text begins with a comment that says which direction its transform holds,
/// with one point taken through it. Parts that are not known make no file.
/// @param camera  the lens, for the formats that want it beside the mounting; nothing for a rig without camera
std::vector<NamedText> formatExports(const RigConfig& rig, const std::optional<CameraModel>& camera,
                                     const CalibrationEstimate& estimate);

/// Names of all files that formatExports() may make.
std::vector<std::string> exportNames();

}  // namespace cocalib
