#include "cocalib/io/result_file.h"

#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "cocalib/measurements/validity.h"
#include "text_format.h"
#include "yaml_section.h"

namespace cocalib {
namespace {

constexpr double kAny = 1e300;  // bound of what may be any number
constexpr std::size_t kLargestFile = 1U << 20U;

std::string formatStamp(TimeNs stamp) {
  const bool negative = stamp < 0;
  const auto magnitude = negative ? 0 - static_cast<std::uint64_t>(stamp) : static_cast<std::uint64_t>(stamp);
  std::string fraction = std::to_string(magnitude % 1'000'000'000U);
  fraction.insert(0, 9 - fraction.size(), '0');
  return (negative ? "-" : "") + std::to_string(magnitude / 1'000'000'000U) + "." + fraction;
}

/// In double quotes, on one line.
std::string formatText(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return quoted + "\"";
}

std::string formatSection(const std::string& section, const std::string& transform, const Pose& pose,
                          double time_offset_s, const SensorVerdict& verdict, const std::string& offset_comment) {
  std::string text = section + ":\n  " + transform + ": {translation: " + formatList(pose.t) +
                     ", rotation_xyzw: " + formatList(pose.q.coeffs()) + "}\n";
  text += "  time_offset: " + formatNumber(time_offset_s) + "  # s, " + offset_comment + "\n";
  text += "  sigma: {translation: " + formatList(verdict.sigma.head<3>()) +
          ", rotation: " + formatList(verdict.sigma.tail<3>()) +
          ", time_offset: " + formatNumber(verdict.time_offset_sigma_s) + "}  # m, rad, s; 1 sigma\n";
  text += "  unobservable: [";
  for (std::size_t i = 0; i < verdict.unobservable.size(); ++i) {
    text += (i > 0 ? ", " : "") + formatText(verdict.unobservable[i]);
  }
  return text + "]\n";
}

std::string formatJointCovariance(const Matrix14d& covariance) {
  std::string text = "# order: camera t, r, lidar t, r, camera offset, lidar offset; m, rad, s\njoint_covariance:\n";
  for (Eigen::Index row = 0; row < covariance.rows(); ++row) {
    text += "  - " + formatList(covariance.row(row).transpose()) + "\n";
  }
  return text;
}

Pose readPose(YamlSection section) {
  const std::vector<double> t = section.numbers("translation", 3);
  const std::vector<double> q = section.numbers("rotation_xyzw", 4);
  section.finish();
  Pose pose;
  pose.t = Eigen::Vector3d(t[0], t[1], t[2]);
  pose.q.coeffs() = Eigen::Vector4d(q[0], q[1], q[2], q[3]);
  if (!isUsable(pose)) section.fail("rotation_xyzw", "must have length 1, and translation be below 1000 km");
  // What was written comes back bit by bit; what was typed in by hand is made exact.
  if (std::abs(pose.q.norm() - 1.0) > 1e-12) pose.q.normalize();
  return pose;
}

SensorVerdict readSection(YamlSection section, const std::string& transform, Pose* pose, double* time_offset_s) {
  SensorVerdict verdict;
  verdict.valid = true;
  *pose = readPose(section.section(transform));
  *time_offset_s = section.number("time_offset", -kLargestTimeOffset_s, kLargestTimeOffset_s, "s");
  YamlSection sigma = section.section("sigma");
  const std::vector<double> translation = sigma.reals("translation", 3);
  const std::vector<double> rotation = sigma.reals("rotation", 3);
  verdict.sigma << translation[0], translation[1], translation[2], rotation[0], rotation[1], rotation[2];
  verdict.time_offset_sigma_s = sigma.real("time_offset");
  sigma.finish();
  verdict.unobservable = section.texts("unobservable");
  section.finish();
  return verdict;
}

Status readStatus(YamlSection* top) {
  const std::string word = top->word("status", {"converged", "converging", "unobservable", "insufficient_data"});
  for (const Status status : {Status::kConverged, Status::kConverging, Status::kUnobservable}) {
    if (word == toString(status)) return status;
  }
  return Status::kInsufficientData;
}

/// Seconds with up to nine decimals -> nanoseconds, digit by digit: a double would lose some.
TimeNs readStamp(YamlSection* top) {
  const std::string text = top->text("stamp");
  const std::size_t begin = text.front() == '-' ? 1 : 0;
  const std::size_t point = text.find('.');
  const std::string seconds = text.substr(begin, point == std::string::npos ? point : point - begin);
  std::string fraction = point == std::string::npos ? "" : text.substr(point + 1);
  const std::string digits = seconds + fraction;
  if (seconds.empty() || seconds.size() > 10 || seconds > (seconds.size() == 10 ? "9223372035" : ":") ||
      fraction.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos) {
    top->fail("stamp", "must be seconds with up to nine decimals");
  }
  fraction.append(9 - fraction.size(), '0');
  const TimeNs stamp = std::stoll(seconds) * 1'000'000'000 + std::stoll(fraction);
  return begin == 1 ? -stamp : stamp;
}

void readImuSection(YamlSection section, CalibrationEstimate* estimate) {
  const std::vector<double> gyro = section.numbers("gyroscope_bias", 3);
  const std::vector<double> accel = section.numbers("accelerometer_bias", 3);
  estimate->gyro_bias = Eigen::Vector3d(gyro[0], gyro[1], gyro[2]);
  estimate->accel_bias = Eigen::Vector3d(accel[0], accel[1], accel[2]);
  estimate->gravity = section.number("gravity", -kAny, kAny, "m/s^2");
  section.finish();
}

void readCovariance(YamlSection* top, Matrix14d* covariance) {
  const YAML::Node rows = top->node("joint_covariance");
  const auto malformed = [top] { top->fail("joint_covariance", "must be 14 rows of 14 numbers"); };
  if (!rows.IsSequence() || rows.size() != 14) malformed();
  for (Eigen::Index i = 0; i < 14; ++i) {
    const YAML::Node row = rows[static_cast<std::size_t>(i)];
    if (!row.IsSequence() || row.size() != 14) malformed();
    for (Eigen::Index j = 0; j < 14; ++j) {
      if (!decodeNumber(row[static_cast<std::size_t>(j)], &(*covariance)(i, j))) malformed();
    }
  }
}

void readQuality(YamlSection section, Quality* quality) {
  quality->reprojection_rms_px = section.real("reprojection_rms_px");
  quality->lidar_plane_rms_m = section.real("lidar_plane_rms_m");
  quality->board_views = section.integer("board_views", 0, std::numeric_limits<int>::max());
  quality->board_lidar_points = section.integer("board_lidar_points", 0, std::numeric_limits<int>::max());
  quality->keyframes = section.integer("keyframes", 0, std::numeric_limits<int>::max());
  section.finish();
}

CalibrationEstimate readResult(const YAML::Node& root, const std::string& path) {
  YamlSection top(root, path, "");
  CalibrationEstimate estimate;
  top.integer("cocalib", 1, 1);
  estimate.status = readStatus(&top);
  if (top.has("message")) estimate.message = root["message"].Scalar();
  estimate.stamp = readStamp(&top);
  estimate.duration_s = top.number("duration", 0.0, kAny, "s");
  Calibration& calibration = estimate.calibration;
  if (top.has("camera")) {
    estimate.camera = readSection(top.section("camera"), "T_imu_camera", &calibration.T_imu_camera,
                                  &calibration.camera_time_offset_s);
  }
  if (top.has("lidar")) {
    estimate.lidar =
        readSection(top.section("lidar"), "T_imu_lidar", &calibration.T_imu_lidar, &calibration.lidar_time_offset_s);
  }
  if (top.has("lidar_camera")) {
    Pose derived;  // both follow from the other two sections
    double offset_s = 0.0;
    estimate.lidar_camera = readSection(top.section("lidar_camera"), "T_lidar_camera", &derived, &offset_s);
  }
  readImuSection(top.section("imu"), &estimate);
  if (top.has("joint_covariance")) readCovariance(&top, &estimate.covariance);
  readQuality(top.section("quality"), &estimate.quality);
  top.finish();
  return estimate;
}

}  // namespace

std::string formatResult(const CalibrationEstimate& estimate, const ResultContents& contents) {
  const Calibration& calibration = estimate.calibration;
  const bool camera = contents.camera && estimate.camera.valid;
  const bool lidar = contents.lidar && estimate.lidar.valid;
  std::string text = "cocalib: 1\nstatus: " + std::string(toString(estimate.status)) + "\n";
  if (!estimate.message.empty()) text += "message: " + formatText(estimate.message) + "\n";
  text += "stamp: " + formatStamp(estimate.stamp) + "  # time of the last measurement used, s\n";
  text += "duration: " + formatNumber(estimate.duration_s) + "  # s of data used\n";
  if (camera) {
    text += formatSection("camera", "T_imu_camera", calibration.T_imu_camera, calibration.camera_time_offset_s,
                          estimate.camera, "t_imu = t_camera + time_offset");
  }
  if (lidar) {
    text += formatSection("lidar", "T_imu_lidar", calibration.T_imu_lidar, calibration.lidar_time_offset_s,
                          estimate.lidar, "t_imu = t_lidar + time_offset");
  }
  if (camera && lidar && estimate.lidar_camera.valid) {
    text += formatSection("lidar_camera", "T_lidar_camera", calibration.T_lidar_camera(),
                          calibration.camera_time_offset_s - calibration.lidar_time_offset_s, estimate.lidar_camera,
                          "t_lidar = t_camera + time_offset");
  }
  text += "imu: {gyroscope_bias: " + formatList(estimate.gyro_bias) +
          ", accelerometer_bias: " + formatList(estimate.accel_bias) + ", gravity: " + formatNumber(estimate.gravity) +
          "}  # rad/s, m/s^2\n";
  if (camera || lidar) text += formatJointCovariance(estimate.covariance);
  const Quality& quality = estimate.quality;
  text += "quality: {reprojection_rms_px: " + formatNumber(quality.reprojection_rms_px) +
          ", lidar_plane_rms_m: " + formatNumber(quality.lidar_plane_rms_m) +
          ", board_views: " + std::to_string(quality.board_views) +
          ", board_lidar_points: " + std::to_string(quality.board_lidar_points) +
          ", keyframes: " + std::to_string(quality.keyframes) + "}\n";
  return text;
}

CalibrationEstimate loadResult(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw YamlError(path + ": cannot be opened");
  std::string text;
  for (std::istreambuf_iterator<char> it(file), end; it != end && text.size() <= kLargestFile; ++it) text += *it;
  if (text.size() > kLargestFile) throw YamlError(path + ": is no result (larger than 1 MiB)");
  return parseResult(text, path);
}

CalibrationEstimate parseResult(const std::string& yaml, const std::string& path) {
  try {
    return readResult(YAML::Load(yaml), path);
  } catch (const YAML::Exception& error) {
    throw YamlError(path + " line " + std::to_string(error.mark.line + 1) + ": no valid YAML: " + error.msg);
  }
}

}  // namespace cocalib
