#pragma once

#include <string>
#include <vector>

#include "cocalib/estimation/convergence.h"

namespace cocalib {

/// Declares a joint estimate converged, or says what it still lacks: every sigma below its threshold, two halves of the
/// data that agree within their covariance, and each sensor's own calibration in agreement with the joint one, so that
/// the loop from IMU over camera, board and lidar back to the IMU closes.
class ConvergenceJudge {
 public:
  ConvergenceJudge(bool camera, bool lidar) : camera_(camera), lidar_(lidar) {}

  /// Fills verdicts, status and message of `joint`, and remembers it for the next ones. Estimates come in order.
  /// @param camera_alone, lidar_alone  of the two calibrators; used where the rig has both sensors
  /// @param camera_scale_unseen        see judgeEstimate()
  void judge(const CalibrationEstimate& camera_alone, const CalibrationEstimate& lidar_alone, bool camera_scale_unseen,
             CalibrationEstimate* joint);
  void reset() { history_.clear(); }

 private:
  std::vector<int> estimatedRows() const;
  std::string doubt(const CalibrationEstimate& camera_alone, const CalibrationEstimate& lidar_alone,
                    const CalibrationEstimate& joint) const;

  bool camera_, lidar_;
  EstimateHistory history_;
};

}  // namespace cocalib
