#pragma once

#include <string>

#include "cocalib/estimation/estimate.h"
#include "cocalib/sim/scenario.h"

namespace cocalib::bench {

/// What takes part in a trial.
struct TrialOptions {
  bool camera = true, lidar = true, board = true;
  bool tracks = true;             ///< natural features; board corners alone otherwise
  double image_rate_hz = 16.667;  ///< pictures measured, of the camera's 50 Hz
};

/// One calibration of one simulated recording, beside its truth.
struct Trial {
  Calibration truth;
  CalibrationEstimate visual, lidar, joint;  ///< visual and lidar: of the two calibrators alone
  struct Cpu {
    double camera_s = 0.0, lidar_s = 0.0, joint_s = 0.0, last_round_s = 0.0;
  } cpu;  ///< of the estimators, without the simulation
};

/// Runs the three calibrators on simulated measurements: corners and tracks with white noise instead of pictures,
/// everything else as the sensors give it. Truth goes nowhere but into the result.
Trial runTrial(const sim::Scenario& scenario, const TrialOptions& options);

/// Reads what calibrate_bag wrote (`DIR/calibration.yaml`) and the truth that `simulate` wrote beside the bag.
/// @throws std::runtime_error naming the file
Trial loadTrial(const std::string& result_dir, const std::string& truth_file);

}  // namespace cocalib::bench
