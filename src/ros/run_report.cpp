#include "cocalib/ros/run_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "cocalib/io/report.h"

namespace cocalib {
namespace {

constexpr int kSide = 480;       // px of one view from above
constexpr double kReachM = 6.0;  // from its middle to its border
constexpr double kLowM = -1.5, kHighM = 1.5;

std::string encode(const cv::Mat& picture, const char* extension) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(extension, picture, bytes);
  return {bytes.begin(), bytes.end()};
}

ReportPicture photo(const std::string& title, const cv::Mat& picture) {
  return {title, "image/jpeg", encode(picture, ".jpg"), false};
}

cv::Mat drawFromAbove(const std::vector<Eigen::Vector3d>& points, const std::string& caption) {
  static const cv::Mat colours = [] {
    cv::Mat ramp(1, 256, CV_8UC1), out;
    for (int i = 0; i < 256; ++i) ramp.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(i);
    cv::applyColorMap(ramp, out, cv::COLORMAP_JET);
    return out;
  }();
  cv::Mat view(kSide, kSide, CV_8UC3, cv::Scalar::all(25));
  for (const Eigen::Vector3d& p : points) {
    const int u = static_cast<int>(std::lround(0.5 * kSide * (1.0 - p.y() / kReachM)));
    const int v = static_cast<int>(std::lround(0.5 * kSide * (1.0 - p.x() / kReachM)));
    if (u < 0 || v < 0 || u >= kSide || v >= kSide) continue;
    const double height = std::clamp((p.z() - kLowM) / (kHighM - kLowM), 0.0, 1.0);
    view.at<cv::Vec3b>(v, u) = colours.at<cv::Vec3b>(0, static_cast<int>(255.0 * height));
  }
  cv::putText(view, caption, {8, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(235), 1, cv::LINE_AA);
  return view;
}

/// How fast the rig turned during a scene [rad/s].
double turnRate(const OverlayScene& scene) {
  double square = 0.0;
  for (const ImuSample& sample : scene.imu) square += sample.gyro.squaredNorm();
  return scene.imu.empty() ? 0.0 : std::sqrt(square / static_cast<double>(scene.imu.size()));
}

/// Before and after over the same picture, moment by moment; then one sweep deskewed.
void addScenes(const RigConfig& rig, const RunResult& result, std::vector<ReportPicture>* pictures) {
  const OverlayCalibration before = {nominalCalibration(rig.guess_T_imu_camera, rig.guess_T_imu_lidar), std::nullopt,
                                     "before"};
  const OverlayCalibration after = {result.estimate.calibration, result.T_W_B, "after"};
  const TimeNs first = result.scenes.front().image.stamp;
  for (const OverlayScene& scene : result.scenes) {
    char moment[32];
    std::snprintf(moment, sizeof moment, "%.1f s", toSeconds(scene.image.stamp - first));
    for (const OverlayCalibration& with : {before, after}) {
      pictures->push_back(photo("Sweep over the picture, " + with.caption + ", at " + moment,
                                drawOverlay(scene, with, *result.camera, rig.target)));
    }
  }
  const auto fastest =
      std::max_element(result.scenes.begin(), result.scenes.end(),
                       [](const OverlayScene& a, const OverlayScene& b) { return turnRate(a) < turnRate(b); });
  if (!result.estimate.lidar.valid) return;
  char title[120];
  std::snprintf(title, sizeof title, "A sweep from above while the rig turned at %.0f deg/s: raw, and deskewed",
                turnRate(*fastest) * 180.0 / M_PI);
  pictures->push_back({title, "image/png", encode(drawDeskew(*fastest, result.estimate.calibration), ".png"), true});
}

}  // namespace

cv::Mat drawDeskew(const OverlayScene& scene, const Calibration& calibration) {
  std::vector<Eigen::Vector3d> raw, deskewed;
  for (const LidarPoint& point : scene.scan.points) raw.push_back(calibration.T_imu_lidar * point.p.cast<double>());
  for (const Eigen::Vector3d& p_C : pointsInCamera(scene, calibration))
    deskewed.push_back(calibration.T_imu_camera * p_C);
  cv::Mat both;
  cv::hconcat(drawFromAbove(raw, "raw"), drawFromAbove(deskewed, "deskewed"), both);
  return both;
}

std::string makeReport(const RigConfig& rig, const RunResult& result) {
  ReportContents contents;
  contents.findings = result.findings;
  contents.motion = result.motion;
  contents.board = result.board;
  contents.residuals = result.residuals;
  contents.pictures.push_back(
      {"Every parameter over the seconds of data, as deviation from its last value, with 1 sigma", "image/png",
       encode(result.log.draw(), ".png"), true});
  if (!result.scenes.empty() && result.camera) addScenes(rig, result, &contents.pictures);
  return formatReport(rig, result.estimate, contents);
}

}  // namespace cocalib
