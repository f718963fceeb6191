#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <utility>

#include "cocalib/estimation/estimate.h"
#include "cocalib/io/rig_config.h"

namespace cocalib {

/// What the formats are made from. Each function below takes for granted that the parts it writes are known.
struct ExportSource {
  const RigConfig& rig;
  const std::optional<CameraModel>& camera;
  const CalibrationEstimate& estimate;
};

/// Lines of a comment, one after the other, each behind `mark` ("# ").
class ExportComment {
 public:
  explicit ExportComment(std::string mark) : mark_(std::move(mark)) {}
  ExportComment& say(const std::string& line) {
    text_ += mark_ + line + "\n";
    return *this;
  }
  /// "Worked point: (1, 2, 3) m in the IMU frame is (...) m in the camera frame."
  ExportComment& work(const Pose& T_to_from, const std::string& from, const std::string& to);
  /// Where the numbers come from, and how far they can be trusted.
  ExportComment& sayStatus(const CalibrationEstimate& estimate);
  const std::string& text() const { return text_; }

 private:
  std::string mark_, text_;
};

/// The lens with four coefficients, as Kalibr and those after it know it: k1 k2 p1 p2, or k1..k4 of an equidistant one.
/// Nothing where more coefficients are needed.
std::optional<Eigen::Vector4d> fourCoefficients(const CameraModel& camera);

/// Row by row.
std::string formatRows(const Eigen::Matrix3d& R);

/// Fixed-axis roll, pitch, yaw [rad] with R = Rz(yaw) Ry(pitch) Rx(roll) exactly, at any pitch: where roll and yaw turn
/// about the same axis, roll is what rounding makes it and yaw fits to it.
Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R);

std::string formatKalibrChain(const ExportSource& source);
std::string formatOpenVins(const ExportSource& source);
std::string formatVinsMono(const ExportSource& source);
std::string formatLviSamCamera(const ExportSource& source);
std::string formatLviSamLidar(const ExportSource& source);
std::string formatLioSam(const ExportSource& source);
std::string formatFastLio(const ExportSource& source);
std::string formatUrdf(const ExportSource& source);
std::string formatStaticTransforms(const ExportSource& source);

}  // namespace cocalib
