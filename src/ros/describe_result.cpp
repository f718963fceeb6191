#include <cmath>
#include <cstdarg>
#include <cstdio>

#include "cocalib/ros/result_files.h"

namespace cocalib {
namespace {

__attribute__((format(printf, 1, 2))) std::string format(const char* pattern, ...) {
  char text[256];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(text, sizeof(text), pattern, arguments);
  va_end(arguments);
  return text;
}

/// Fixed-axis roll, pitch, yaw [rad]: R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

std::string describeTransform(const std::string& name, const Pose& T, const SensorVerdict& verdict) {
  if (!verdict.valid) return "  " + name + ": not known\n";
  constexpr double kDeg = 180.0 / M_PI;
  const Eigen::Vector3d rpy = rollPitchYaw(T.R()) * kDeg;
  const Vector6d& s = verdict.sigma;
  std::string text = "  " + name + "\n";
  text += format("    translation      %10.4f %10.4f %10.4f m     +- %7.2f %7.2f %7.2f mm\n", T.t.x(), T.t.y(), T.t.z(),
                 1e3 * s[0], 1e3 * s[1], 1e3 * s[2]);
  text += format("    roll pitch yaw   %10.3f %10.3f %10.3f deg   +- %7.3f %7.3f %7.3f deg\n", rpy.x(), rpy.y(),
                 rpy.z(), kDeg * s[3], kDeg * s[4], kDeg * s[5]);
  return text;
}

std::string describeOffset(double offset_s, const SensorVerdict& verdict) {
  if (!verdict.valid) return "";
  return format("    clock offset     %10.3f ms                         +- %7.3f ms\n", 1e3 * offset_s,
                1e3 * verdict.time_offset_sigma_s);
}

std::string describeUnobservable(const char* sensor, const SensorVerdict& verdict) {
  std::string text;
  for (const std::string& direction : verdict.unobservable) {
    text += "  not determined (" + std::string(sensor) + "): " + direction + "\n";
  }
  return text;
}

const char* meaningOf(Status status) {
  switch (status) {
    case Status::kConverged:
      return "the data determine the calibration";
    case Status::kConverging:
      return "usable, but more data would still improve it";
    case Status::kUnobservable:
      return "the motion leaves directions undetermined; they keep their starting value";
    case Status::kInsufficientData:
      break;
  }
  return "the data are not enough for a calibration: longer recordings, all sensors at their normal rates, more "
         "rotation";
}

}  // namespace

std::string describeResult(const RigConfig& rig, const CalibrationEstimate& estimate) {
  const Calibration& calibration = estimate.calibration;
  std::string text = format("status: %s after %.1f s of data (%s)\n", toString(estimate.status), estimate.duration_s,
                            meaningOf(estimate.status));
  if (!estimate.message.empty()) text += "  " + estimate.message + "\n";
  if (rig.camera) {
    text += describeTransform("T_imu_camera", calibration.T_imu_camera, estimate.camera);
    text += describeOffset(calibration.camera_time_offset_s, estimate.camera);
  }
  if (rig.lidar) {
    text += describeTransform("T_imu_lidar", calibration.T_imu_lidar, estimate.lidar);
    text += describeOffset(calibration.lidar_time_offset_s, estimate.lidar);
  }
  if (rig.camera && rig.lidar) {
    text += describeTransform("T_lidar_camera", calibration.T_lidar_camera(), estimate.lidar_camera);
  }
  if (rig.camera) text += describeUnobservable("camera", estimate.camera);
  if (rig.lidar) text += describeUnobservable("lidar", estimate.lidar);
  if (rig.camera && estimate.camera.valid) {
    text += format("  reprojection %.2f px rms, %d board views\n", estimate.quality.reprojection_rms_px,
                   estimate.quality.board_views);
  }
  if (rig.lidar && estimate.lidar.valid) {
    text += format("  lidar planes %.1f mm rms, %d points on the board\n", 1e3 * estimate.quality.lidar_plane_rms_m,
                   estimate.quality.board_lidar_points);
  }
  return text;
}

}  // namespace cocalib
