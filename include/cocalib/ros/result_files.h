#pragma once

#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/residual_samples.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/measurements/finding.h"
#include "cocalib/monitor/coverage.h"
#include "cocalib/ros/convergence_log.h"
#include "cocalib/ros/overlay.h"

namespace cocalib {

constexpr std::size_t kReportScenes = 5;  ///< moments of a run that the report shows

/// Everything a finished run leaves behind.
struct RunResult {
  CalibrationEstimate estimate;
  ConvergenceLog log;
  std::optional<OverlayScene> scene;  ///< nothing without camera, lidar or a picture worth showing
  std::optional<CameraModel> camera;
  std::optional<Pose> T_W_B;         ///< board in the world of the scenes' states
  std::vector<OverlayScene> scenes;  ///< some moments of the run, for the report
  std::vector<Finding> findings;     ///< of the input doctor
  MotionCoverage motion;
  BoardCoverage board;
  ResidualSamples residuals;
};

/// Makes sure that `directory` exists and can be written, before an hour of work goes into a run.
/// @throws std::runtime_error naming it and the cause
void prepareOutputDirectory(const std::string& directory);

/// calibration.yaml first, then the files for other programs (formatExports()), report.html, convergence.csv,
/// convergence.png, overlay_before.png and overlay_after.png, each written atomically. A directory that has vanished is
/// made again. @throws std::runtime_error naming file and cause
void writeResultFiles(const std::string& directory, const RigConfig& rig, const RunResult& result);

/// The calibration for people: both mountings with 1 sigma, clock offsets, what is not determined, and what to do.
std::string describeResult(const RigConfig& rig, const CalibrationEstimate& estimate);

}  // namespace cocalib
