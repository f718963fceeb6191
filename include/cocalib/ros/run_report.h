#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

#include "cocalib/io/rig_config.h"
#include "cocalib/ros/result_files.h"

namespace cocalib {

/// One sweep from above, as it came (left) and deskewed with the calibration (right), in the IMU's frame at the time of
/// the scene's picture; colour by height. BGR, twice as wide as high.
cv::Mat drawDeskew(const OverlayScene& scene, const Calibration& calibration);

/// report.html of a finished run.
std::string makeReport(const RigConfig& rig, const RunResult& result);

}  // namespace cocalib
