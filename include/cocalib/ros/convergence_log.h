#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// How the estimate came to be what it is: every estimate of a run, as a table and as a picture. Not thread-safe.
class ConvergenceLog {
 public:
  /// Long runs keep every second entry from time to time, so that memory stays bounded.
  void add(const CalibrationEstimate& estimate);
  void clear() { entries_.clear(); }
  bool empty() const { return entries_.empty(); }

  /// One line per estimate; the header names columns and units.
  std::string csv() const;

  /// 800x600 or larger: translation, rotation and clock offset of each sensor as deviation from the newest estimate
  /// over the seconds of data, each with its 1-sigma band. BGR.
  cv::Mat draw(const cv::Size& size = {960, 720}) const;

 private:
  std::vector<CalibrationEstimate> entries_;
};

}  // namespace cocalib
