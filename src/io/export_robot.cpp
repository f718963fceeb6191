#include <vector>

#include "export_formats.h"
#include "text_format.h"

namespace cocalib {
namespace {

/// In XML's attribute values.
std::string escapeXml(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '&')
      escaped += "&amp;";
    else if (c == '<')
      escaped += "&lt;";
    else if (c == '"')
      escaped += "&quot;";
    else
      escaped += c;
  }
  return escaped;
}

std::string formatBlanks(const Eigen::VectorXd& values) {
  std::string text;
  for (Eigen::Index i = 0; i < values.size(); ++i) text += (i > 0 ? " " : "") + formatNumber(values[i]);
  return text;
}

/// The mountings that are known, by the names of their frames.
struct Mounting {
  std::string sensor, frame;
  Pose T_imu_sensor;
};
std::vector<Mounting> mountingsOf(const ExportSource& source) {
  std::vector<Mounting> all;
  const Calibration& calibration = source.estimate.calibration;
  if (source.rig.camera && source.estimate.camera.valid) {
    all.push_back({"camera", source.rig.camera->frame, calibration.T_imu_camera});
  }
  if (source.rig.lidar && source.estimate.lidar.valid) {
    all.push_back({"lidar", source.rig.lidar->frame, calibration.T_imu_lidar});
  }
  return all;
}

std::string formatXmlComment(const ExportSource& source, const std::string& first) {
  ExportComment comment("     ");
  comment.say(first).sayStatus(source.estimate);
  for (const Mounting& mounting : mountingsOf(source)) {
    comment.say("The " + mounting.sensor + "'s takes coordinates in its frame to the IMU frame:");
    comment.work(mounting.T_imu_sensor, mounting.sensor, "IMU");
  }
  return "<!--\n" + comment.text() + "-->\n";
}

}  // namespace

std::string formatUrdf(const ExportSource& source) {
  std::string text =
      "<?xml version=\"1.0\"?>\n" +
      formatXmlComment(source, "URDF joints, to be included in the description of a robot that has the IMU's link.") +
      "<robot name=\"cocalib_sensors\" xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n";
  for (const Mounting& mounting : mountingsOf(source)) {
    const std::string frame = escapeXml(mounting.frame);
    text += "  <link name=\"" + frame + "\"/>\n  <joint name=\"imu_to_" + mounting.sensor +
            "\" type=\"fixed\">\n    <parent link=\"" + escapeXml(source.rig.imu.frame) + "\"/>\n    <child link=\"" +
            frame + "\"/>\n    <origin xyz=\"" + formatBlanks(mounting.T_imu_sensor.t) + "\" rpy=\"" +
            formatBlanks(rollPitchYaw(mounting.T_imu_sensor.R())) + "\"/>\n  </joint>\n";
  }
  return text + "</robot>\n";
}

std::string formatStaticTransforms(const ExportSource& source) {
  std::string text =
      formatXmlComment(source,
                       "Static transforms, args: x y z qx qy qz qw parent child. Not beside a running cocalib, which "
                       "publishes these itself.") +
      "<launch>\n";
  for (const Mounting& mounting : mountingsOf(source)) {
    const Pose& T = mounting.T_imu_sensor;
    text += "  <node pkg=\"tf2_ros\" type=\"static_transform_publisher\" name=\"imu_to_" + mounting.sensor +
            "\" args=\"" + formatBlanks(T.t) + " " + formatBlanks(T.q.coeffs()) + " " +
            escapeXml(source.rig.imu.frame) + " " + escapeXml(mounting.frame) + "\"/>\n";
  }
  return text + "</launch>\n";
}

}  // namespace cocalib
