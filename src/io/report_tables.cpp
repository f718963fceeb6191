#include <cmath>

#include "cocalib/geometry/pose_covariance.h"
#include "export_formats.h"
#include "report_parts.h"

namespace cocalib {
namespace {

constexpr double kDeg = 180.0 / M_PI;

const char* meaningOf(Status status) {
  switch (status) {
    case Status::kConverged:
      return "The data determine the calibration.";
    case Status::kConverging:
      return "Usable, but more data would still improve it noticeably.";
    case Status::kUnobservable:
      return "The motion leaves directions undetermined; along them the values are only what they started from.";
    case Status::kInsufficientData:
      break;
  }
  return "Nothing could be found; the numbers mean nothing.";
}

std::string unobservableItems(const char* sensor, const SensorVerdict& verdict) {
  std::string text;
  for (const std::string& direction : verdict.unobservable) {
    text += "<li><span class=\"error\">not determined</span> " + std::string(sensor) + ": " + escapeHtml(direction) +
            "</li>\n";
  }
  return text;
}

std::string qualityRow(const char* name, const std::string& value) {
  return "<tr><td class=\"left\">" + std::string(name) + "</td><td>" + value + "</td></tr>\n";
}

/// One direction of a transform as a row: translation, angles, quaternion, sigmas.
std::string transformRow(const std::string& name, const Pose& T, const Matrix6d& covariance) {
  const Eigen::Vector3d rpy = rollPitchYaw(T.R()) * kDeg;
  const Vector6d sigma = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Eigen::Vector4d q = T.q.coeffs();
  std::string text = "<tr><td class=\"left\"><b>" + name + "</b></td>";
  text += formatText("<td>%.5f<br>%.5f<br>%.5f</td><td>%.2f<br>%.2f<br>%.2f</td>", T.t.x(), T.t.y(), T.t.z(),
                     1e3 * sigma[0], 1e3 * sigma[1], 1e3 * sigma[2]);
  text += formatText("<td>%.4f<br>%.4f<br>%.4f</td><td>%.4f<br>%.4f<br>%.4f</td>", rpy.x(), rpy.y(), rpy.z(),
                     kDeg * sigma[3], kDeg * sigma[4], kDeg * sigma[5]);
  return text + formatText("<td>%.7f<br>%.7f<br>%.7f<br>%.7f</td></tr>\n", q[0], q[1], q[2], q[3]);
}

std::string bothRows(const std::string& a, const std::string& b, const Pose& T_a_b, const Matrix6d& covariance) {
  return transformRow("T_" + a + "_" + b, T_a_b, covariance) +
         transformRow("T_" + b + "_" + a, T_a_b.inverse(), covarianceOfInverse(T_a_b, covariance));
}

std::string offsetLine(const char* sensor, double offset_s, const SensorVerdict& verdict) {
  return formatText("<li>t_imu = t_%s %s %.4f ms &plusmn; %.4f ms</li>\n", sensor, offset_s < 0.0 ? "-" : "+",
                    1e3 * std::abs(offset_s), 1e3 * verdict.time_offset_sigma_s);
}

}  // namespace

std::string reportSummary(const RigConfig& rig, const CalibrationEstimate& estimate) {
  const std::string status = toString(estimate.status);
  std::string text = "<p><span class=\"status " + status + "\">" + status + "</span> " +
                     formatText("after %.1f s of data. ", estimate.duration_s) + meaningOf(estimate.status);
  if (!estimate.message.empty()) text += "<br>" + escapeHtml(estimate.message);
  text += "</p>\n";
  const std::string open = (rig.camera ? unobservableItems("camera", estimate.camera) : "") +
                           (rig.lidar ? unobservableItems("lidar", estimate.lidar) : "");
  if (!open.empty()) text += "<ul>\n" + open + "</ul>\n";
  const Quality& quality = estimate.quality;
  text += "<table>\n";
  if (rig.camera) {
    text += qualityRow("reprojection error, rms", formatText("%.3f px", quality.reprojection_rms_px));
    if (rig.target) text += qualityRow("views of the board", formatText("%d", quality.board_views));
  }
  if (rig.lidar) {
    text +=
        qualityRow("distance of points to their planes, rms", formatText("%.1f mm", 1e3 * quality.lidar_plane_rms_m));
    if (rig.target) text += qualityRow("lidar points on the board", formatText("%d", quality.board_lidar_points));
  }
  const Eigen::Vector3d &g = estimate.gyro_bias, &a = estimate.accel_bias;
  text += qualityRow("gyroscope bias", formatText("%.5f, %.5f, %.5f rad/s", g.x(), g.y(), g.z()));
  text += qualityRow("accelerometer bias", formatText("%.4f, %.4f, %.4f m/s&sup2;", a.x(), a.y(), a.z()));
  return text + qualityRow("gravity", formatText("%.4f m/s&sup2;", estimate.gravity)) + "</table>\n";
}

std::string reportTransforms(const RigConfig& rig, const CalibrationEstimate& estimate) {
  const bool camera = rig.camera && estimate.camera.valid, lidar = rig.lidar && estimate.lidar.valid;
  if (!camera && !lidar) return "";
  const Calibration& calibration = estimate.calibration;
  const Matrix14d& P = estimate.covariance;
  std::string text =
      "<h2>Transforms</h2>\n<p>T_a_b takes coordinates in frame b to frame a: p_a = T_a_b p_b. Uncertainties are 1 "
      "sigma, "
      "about the axes of frame a. Roll, pitch, yaw: R = Rz Ry Rx.</p>\n<table>\n<tr><th class=\"left\"></th>"
      "<th>translation [m]</th><th>&plusmn; [mm]</th><th>roll pitch yaw [deg]</th><th>&plusmn; [deg]</th>"
      "<th>quaternion x y z w</th></tr>\n";
  if (camera) text += bothRows("imu", "camera", calibration.T_imu_camera, P.block<6, 6>(0, 0));
  if (lidar) text += bothRows("imu", "lidar", calibration.T_imu_lidar, P.block<6, 6>(6, 6));
  if (camera && lidar) {
    text += bothRows("lidar", "camera", calibration.T_lidar_camera(), lidarCameraCovariance(calibration, P));
  }
  text += "</table>\n<p>Clocks:</p>\n<ul>\n";
  if (camera) text += offsetLine("camera", calibration.camera_time_offset_s, estimate.camera);
  if (lidar) text += offsetLine("lidar", calibration.lidar_time_offset_s, estimate.lidar);
  return text + "</ul>\n";
}

std::string reportCorrelation(const CalibrationEstimate& estimate) {
  std::vector<int> rows;
  for (int i = 0; i < 14; ++i) {
    const bool camera = i < 6 || i == 12;
    const double variance = estimate.covariance(i, i);
    if ((camera ? estimate.camera.valid : estimate.lidar.valid) && variance > 0.0 && std::isfinite(variance)) {
      rows.push_back(i);
    }
  }
  if (rows.size() < 2) return "";
  static const char* const kNames[] = {"cam x",   "cam y",   "cam z",    "cam rx",   "cam ry",   "cam rz", "lidar x",
                                       "lidar y", "lidar z", "lidar rx", "lidar ry", "lidar rz", "cam dt", "lidar dt"};
  std::string text = "<h2>Correlation</h2>\n<table class=\"small\">\n<tr><th></th>";
  for (const int i : rows) text += "<th>" + std::string(kNames[i]) + "</th>";
  text += "</tr>\n";
  for (const int i : rows) {
    text += "<tr><th>" + std::string(kNames[i]) + "</th>";
    for (const int j : rows) {
      const double c = estimate.covariance(i, j) / std::sqrt(estimate.covariance(i, i) * estimate.covariance(j, j));
      const char* colour = c > 0.0 ? "220,80,60" : "60,110,220";
      text += formatText("<td style=\"background:rgba(%s,%.2f)\">%.2f</td>", colour,
                         i == j ? 0.15 : 0.8 * std::min(1.0, std::abs(c)), c);
    }
    text += "</tr>\n";
  }
  return text + "</table>\n";
}

std::string reportFindings(const std::vector<Finding>& findings) {
  std::string text = "<h2>Input</h2>\n";
  if (findings.empty()) return text + "<p>Nothing wrong was found with the sensors' data.</p>\n";
  text +=
      "<table>\n<tr><th class=\"left\"></th><th class=\"left\">what is seen</th><th class=\"left\">what to "
      "do</th></tr>\n";
  for (const Finding& finding : findings) {
    const char* weight = finding.weight == Finding::Weight::kError     ? "error"
                         : finding.weight == Finding::Weight::kWarning ? "warning"
                                                                       : "note";
    text += "<tr><td class=\"left " + std::string(weight) + "\">" + weight + "</td><td class=\"left\">" +
            escapeHtml(finding.problem) + "</td><td class=\"left\">" + escapeHtml(finding.remedy) + "</td></tr>\n";
  }
  return text + "</table>\n";
}

}  // namespace cocalib
