#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "cocalib/io/rig_config.h"
#include "cocalib/ros/bag_input.h"
#include "cocalib/ros/result_files.h"

namespace cocalib {

/// Drives the three pipelines from a bag, faster than real time. The camera's, the lidar's and the fuser's work run in
/// parallel on slices of the recording and meet between slices in a fixed order, so the same bag and rig give the
/// same bytes. Not thread-safe.
class BagCalibration {
 public:
  struct Listener {
    std::function<void(const std::string& stage, double part)> progress;  ///< part: 0..1 of the whole run
    std::function<void(const std::string& line)> notice;                  ///< said once each
  };

  /// @throws std::runtime_error if the bag has no usable camera_info
  BagCalibration(const RigConfig& rig, BagInput* input, Listener listener);
  ~BagCalibration();

  /// Reads the bag once and solves. @throws std::runtime_error with one line if the rig file contradicts the data or a
  /// sensor delivered nothing that can be used
  RunResult run();

  /// Wall time spent in each stage of run() so far [s]; the camera's, the lidar's and the fuser's overlap.
  std::map<std::string, double> stageSeconds() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
