#pragma once

#include <string>

#include "cocalib/calibrators/diagnostics.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/ros/messages.h"

namespace cocalib {

/// tf frame names of the rig.
struct FrameNames {
  std::string world = "world", imu = "imu_link", camera = "camera_optical_frame", lidar = "lidar_link";
};

/// The joint estimate as a message. No number in it is NaN or infinite: a part that is not finite is sent as not valid.
CalibrationEstimateMsg toEstimateMsg(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics,
                                     const FrameNames& frames);

/// Back again; the lidar-camera transform is not read, it follows from the other two.
CalibrationEstimate fromEstimateMsg(const CalibrationEstimateMsg& msg);

/// Which sensor's part of an estimate an ExtrinsicEstimate carries.
enum class SensorPart { kCamera, kLidar };

/// One sensor's part of an estimate as a message, finite like the joint one.
ExtrinsicEstimate toExtrinsicMsg(const CalibrationEstimate& estimate, SensorPart part,
                                 const CalibratorDiagnostics& diagnostics, const FrameNames& frames);

/// A sub-calibration's message as an estimate in which only `part` is filled.
CalibrationEstimate fromExtrinsicMsg(const ExtrinsicEstimate& msg, SensorPart part);

/// "converged" -> Status; an unknown word counts as insufficient data.
Status statusFromString(const std::string& word);

}  // namespace cocalib
