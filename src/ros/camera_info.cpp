#include "cocalib/ros/camera_info.h"

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace cocalib {
namespace {

constexpr std::uint32_t kLargestSide = 65536;  // [px]
constexpr std::uint32_t kLargestBinning = 64;

/// Picture as published: part of the sensor, pixels taken together.
struct Window {
  double x = 0.0, y = 0.0;              ///< of its first pixel on the full sensor [px]
  std::uint32_t width = 0, height = 0;  ///< as published [px]
  double binning_x = 1.0, binning_y = 1.0;
};

/// @throws std::invalid_argument
Window findWindow(const sensor_msgs::CameraInfo& msg) {
  if (msg.width == 0 || msg.height == 0 || msg.width > kLargestSide || msg.height > kLargestSide) {
    throw std::invalid_argument("size " + std::to_string(msg.width) + " x " + std::to_string(msg.height) +
                                " is impossible");
  }
  if (msg.binning_x > kLargestBinning || msg.binning_y > kLargestBinning) {
    throw std::invalid_argument("binning " + std::to_string(msg.binning_x) + " x " + std::to_string(msg.binning_y) +
                                " is impossible");
  }
  Window window;
  window.binning_x = std::max(msg.binning_x, 1U);  // 0 means 1
  window.binning_y = std::max(msg.binning_y, 1U);
  std::uint32_t width = msg.width;
  std::uint32_t height = msg.height;
  const sensor_msgs::RegionOfInterest& roi = msg.roi;
  if (roi.width > 0 && roi.height > 0) {  // all zero means the full sensor
    if (std::uint64_t{roi.x_offset} + roi.width > msg.width || std::uint64_t{roi.y_offset} + roi.height > msg.height) {
      throw std::invalid_argument("region of interest reaches out of the picture");
    }
    window.x = roi.x_offset;
    window.y = roi.y_offset;
    width = roi.width;
    height = roi.height;
  }
  window.width = width / std::max(msg.binning_x, 1U);
  window.height = height / std::max(msg.binning_y, 1U);
  return window;
}

/// Drivers pad the coefficients with zeros (up to 14, as OpenCV does); only zeros may be left out.
void dropTrailingZeros(std::size_t count, std::vector<double>* coefficients) {
  while (coefficients->size() > count && coefficients->back() == 0.0) coefficients->pop_back();
}

CameraModel buildModel(const sensor_msgs::CameraInfo& msg) {
  if (std::all_of(msg.K.begin(), msg.K.end(), [](double k) { return k == 0.0; })) {
    throw std::invalid_argument("K is all zero: the camera is not calibrated");
  }
  const Window window = findWindow(msg);
  std::vector<double> coefficients(msg.D.begin(), msg.D.end());
  std::string name = msg.distortion_model;
  if (name.empty() && std::all_of(coefficients.begin(), coefficients.end(), [](double d) { return d == 0.0; })) {
    name = "plumb_bob";  // simulators say nothing of a camera without distortion
    coefficients.clear();
  }
  if (name == "plumb_bob") dropTrailingZeros(5, &coefficients);
  if (name == "rational_polynomial") dropTrailingZeros(8, &coefficients);
  if (name == "equidistant" || name == "fisheye") dropTrailingZeros(4, &coefficients);

  // Centres of pixels have whole numbers: after binning by b, pixel u holds the old b u ... b u + b - 1.
  const Eigen::Vector4d intrinsics(msg.K[0] / window.binning_x, msg.K[4] / window.binning_y,
                                   (msg.K[2] - window.x + 0.5) / window.binning_x - 0.5,
                                   (msg.K[5] - window.y + 0.5) / window.binning_y - 0.5);
  return CameraModel::fromName(name, intrinsics, std::move(coefficients), static_cast<int>(window.width),
                               static_cast<int>(window.height));
}

}  // namespace

std::optional<CameraModel> readCameraInfo(const sensor_msgs::CameraInfo& msg, std::string* problem) {
  try {
    return buildModel(msg);
  } catch (const std::invalid_argument& error) {
    if (problem != nullptr) *problem = std::string("camera_info: ") + error.what();
    return std::nullopt;
  }
}

}  // namespace cocalib
