#include "cocalib/ros/convergence_log.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>

#include "cocalib/estimation/observability.h"
#include "cocalib/ros/line_chart.h"

namespace cocalib {
namespace {

constexpr std::size_t kMostEntries = 2000;
constexpr int kHeadingHeight = 24;  // px
constexpr const char* kLegend =
    "deviation from the newest value over the seconds of data; +- and band: 1 sigma; dashed: as wanted";

/// As in the report; BGR.
cv::Scalar colourOf(Status status) {
  if (status == Status::kConverged) return {60, 125, 43};
  return status == Status::kConverging ? cv::Scalar(0, 111, 176) : cv::Scalar(30, 38, 179);
}

struct Side {
  const Pose& pose;
  double offset_s;
  const SensorVerdict& verdict;
};

Side sideOf(const CalibrationEstimate& estimate, bool camera) {
  const Calibration& calibration = estimate.calibration;
  if (camera) return {calibration.T_imu_camera, calibration.camera_time_offset_s, estimate.camera};
  return {calibration.T_imu_lidar, calibration.lidar_time_offset_s, estimate.lidar};
}

void appendNumber(double value, std::string* line) {
  char text[32];
  std::snprintf(text, sizeof(text), ",%.9g", value);
  *line += text;
}

void appendSide(const Side& side, std::string* line) {
  *line += side.verdict.valid ? ",1" : ",0";
  for (int i = 0; i < 3; ++i) appendNumber(side.pose.t[i], line);
  for (int i = 0; i < 4; ++i) appendNumber(side.pose.q.coeffs()[i], line);
  appendNumber(side.offset_s, line);
  for (int i = 0; i < 6; ++i) appendNumber(side.verdict.sigma[i], line);
  appendNumber(side.verdict.time_offset_sigma_s, line);
}

/// What one panel shows of a side: three translations, three rotations or the clock offset.
enum class Quantity { kTranslation, kRotation, kOffset };

/// Curves over seconds of data, in mm, mrad or ms, as deviation from `last`.
std::vector<Curve> curvesOf(const std::vector<CalibrationEstimate>& entries, bool camera, Quantity quantity) {
  static const std::array<const char*, 3> kAxes = {"x", "y", "z"};
  const int count = quantity == Quantity::kOffset ? 1 : 3;
  const int first = quantity == Quantity::kRotation ? 3 : 0;
  std::vector<Curve> curves(count);
  const Side last = sideOf(entries.back(), camera);
  for (int i = 0; i < count; ++i) curves[i].name = count == 1 ? "" : kAxes[i];
  for (const CalibrationEstimate& entry : entries) {
    const Side side = sideOf(entry, camera);
    if (!isSeen(side.verdict)) continue;
    const Vector6d deviation = side.pose.minus(last.pose);
    for (int i = 0; i < count; ++i) {
      const bool is_offset = quantity == Quantity::kOffset;
      const double value = is_offset ? side.offset_s - last.offset_s : deviation[first + i];
      const double sigma = is_offset ? side.verdict.time_offset_sigma_s : side.verdict.sigma[first + i];
      if (std::isfinite(value) && std::isfinite(sigma)) {
        curves[i].points.push_back({entry.duration_s, 1e3 * value, 1e3 * sigma});
      }
    }
  }
  return curves;
}

}  // namespace

void ConvergenceLog::add(const CalibrationEstimate& estimate) {
  if (!entries_.empty() && estimate.stamp < entries_.back().stamp) entries_.clear();
  if (entries_.size() == kMostEntries) {
    for (std::size_t i = 0; i < kMostEntries / 2; ++i) entries_[i] = entries_[2 * i];
    entries_.resize(kMostEntries / 2);
  }
  entries_.push_back(estimate);
}

std::string ConvergenceLog::csv() const {
  std::string text = "duration_s,status";
  for (const std::string sensor : {"camera", "lidar"}) {
    text += "," + sensor + "_valid";
    for (const char* name : {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "time_offset_s", "sigma_x_m", "sigma_y_m",
                             "sigma_z_m", "sigma_rx_rad", "sigma_ry_rad", "sigma_rz_rad", "sigma_time_offset_s"}) {
      text += "," + sensor + "_" + name;
    }
  }
  text += "\n";
  for (const CalibrationEstimate& entry : entries_) {
    char start[32];
    std::snprintf(start, sizeof(start), "%.3f,", entry.duration_s);
    std::string line = std::string(start) + toString(entry.status);
    appendSide(sideOf(entry, true), &line);
    appendSide(sideOf(entry, false), &line);
    text += line + "\n";
  }
  return text;
}

cv::Mat ConvergenceLog::draw(const cv::Size& size) const {
  cv::Mat image(size, CV_8UC3, cv::Scalar::all(255));
  const bool camera = !entries_.empty() && isSeen(entries_.back().camera);
  const bool lidar = !entries_.empty() && isSeen(entries_.back().lidar);
  if (!camera && !lidar) {
    drawCaption("no estimate yet: turn the rig about all three axes, back and forth", &image);
    return image;
  }
  const CalibrationEstimate& newest = entries_.back();
  const bool asks = newest.status != Status::kConverged && !newest.message.empty();
  cv::Mat strip = image.rowRange(0, kHeadingHeight);
  drawHeading(toString(newest.status), colourOf(newest.status), asks ? newest.message : kLegend, &strip);
  const int columns = camera && lidar ? 2 : 1;
  const int width = size.width / columns, height = (size.height - kHeadingHeight) / 3;
  int column = 0;
  for (const bool is_camera : {true, false}) {
    if (!(is_camera ? camera : lidar)) continue;
    const std::string name = is_camera ? "camera" : "lidar";
    const ObservabilityThresholds wanted;
    const std::array<ChartLabels, 3> labels = {{{name + " translation", "mm", 1e3 * wanted.converged_translation_m},
                                                {name + " rotation", "mrad", 1e3 * wanted.converged_rotation_rad},
                                                {name + " clock offset", "ms", 1e3 * wanted.converged_time_offset_s}}};
    for (int row = 0; row < 3; ++row) {
      cv::Mat panel = image(cv::Rect(column * width, kHeadingHeight + row * height, width, height));
      drawChart(labels[static_cast<std::size_t>(row)], curvesOf(entries_, is_camera, static_cast<Quantity>(row)),
                &panel);
    }
    ++column;
  }
  return image;
}

}  // namespace cocalib
