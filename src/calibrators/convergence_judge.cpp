#include "cocalib/calibrators/convergence_judge.h"

#include "cocalib/estimation/observability.h"

namespace cocalib {

void ConvergenceJudge::judge(const CalibrationEstimate& camera_alone, const CalibrationEstimate& lidar_alone,
                             bool camera_scale_unseen, CalibrationEstimate* joint) {
  judgeEstimate(camera_, lidar_, ObservabilityThresholds(), joint, camera_scale_unseen);
  history_.add(*joint);
  if (joint->status != Status::kConverged) return;
  const std::string why_not = doubt(camera_alone, lidar_alone, *joint);
  if (why_not.empty()) return;
  joint->status = Status::kConverging;
  joint->message = why_not;
}

std::vector<int> ConvergenceJudge::estimatedRows() const {
  std::vector<int> rows;
  for (int i = 0; i < 14; ++i) {
    const bool of_camera = i < 6 || i == 12;
    if (of_camera ? camera_ : lidar_) rows.push_back(i);
  }
  return rows;
}

std::string ConvergenceJudge::doubt(const CalibrationEstimate& camera_alone, const CalibrationEstimate& lidar_alone,
                                    const CalibrationEstimate& joint) const {
  const CalibrationEstimate* half = history_.half();
  if (half == nullptr) return "gathering a second half of data to compare with the first";
  if (const auto what = disagreement(*half, joint, estimatedRows())) {
    return "the first half of the data and all of it differ in " + *what + ": keep moving, or check the mounts";
  }
  if (!camera_ || !lidar_) return {};
  if (const auto what = disagreement(camera_alone, joint, {0, 1, 2, 3, 4, 5, 12})) {
    return "camera and imu alone differ from the joint estimate in " + *what;
  }
  if (const auto what = disagreement(lidar_alone, joint, {6, 7, 8, 9, 10, 11, 13})) {
    return "lidar and imu alone differ from the joint estimate in " + *what;
  }
  return {};
}

}  // namespace cocalib
