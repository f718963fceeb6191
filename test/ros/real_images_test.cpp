#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Imu.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/visual/board_detector.h"
#include "cocalib/visual/feature_tracker.h"

namespace cocalib {
namespace {

// Optional recordings beside the checkout; tests start in the repository's root.
const std::string kData = "../shared/data/";

ImageFrame decode(const sensor_msgs::CompressedImage& message) {
  return {static_cast<TimeNs>(message.header.stamp.toNSec()), cv::imdecode(message.data, cv::IMREAD_GRAYSCALE)};
}

TEST(RealImages, BoardIsFoundInFisheyePictures) {
  const std::string path = kData + "acfr_vlp16_board/acfr_vlp16_board.bag";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no recording at " << path;
  const CameraModel camera(CameraModel::Distortion::kEquidistant, {1176.93, 1177.72, 962.275, 612.725},
                           {-0.0540096, -0.0784275, 0.0959641, -0.0515253}, 1920, 1208);
  const BoardGeometry board{5, 7, 0.095, 0.61, 0.85};
  BoardDetector detector(board, camera, {});
  rosbag::Bag bag(path);
  int pictures = 0, found = 0;
  for (const auto& message : rosbag::View(bag, rosbag::TopicQuery("/camera/image_color/compressed"))) {
    const auto observation = detector.detect(decode(*message.instantiate<sensor_msgs::CompressedImage>()));
    ++pictures;
    if (!observation) continue;
    ++found;
    double rms_px = 0.0;
    ASSERT_TRUE(estimateBoardPose(*observation, board, camera, &rms_px));
    EXPECT_LT(rms_px, 0.5);                          // the lens model's own error included; measured 0.07 to 0.33
    EXPECT_GT(detector.lastPose()->R()(0, 0), 0.0);  // the same way round in all
  }
  EXPECT_EQ(pictures, 18);
  EXPECT_GE(found, 16);
}

/// Pictures and gyro of the EuRoC recording.
struct Recording {
  std::vector<ImageFrame> images;
  std::vector<ImuSample> imu;
};
Recording readEuroc(const std::string& path) {
  Recording recording;
  rosbag::Bag bag(path);
  for (const auto& message : rosbag::View(bag)) {
    if (const auto imu = message.instantiate<sensor_msgs::Imu>()) {
      const auto& w = imu->angular_velocity;
      recording.imu.push_back(
          {static_cast<TimeNs>(imu->header.stamp.toNSec()), {w.x, w.y, w.z}, Eigen::Vector3d::Zero()});
    } else if (const auto image = message.instantiate<sensor_msgs::CompressedImage>()) {
      recording.images.push_back(decode(*image));
    }
  }
  return recording;
}

/// R_a_b of the IMU between two stamps by the midpoint rule.
Eigen::Quaterniond integrateGyro(const std::vector<ImuSample>& imu, TimeNs a, TimeNs b, const Eigen::Vector3d& bias) {
  Eigen::Quaterniond R_a_b = Eigen::Quaterniond::Identity();
  for (std::size_t k = 0; k + 1 < imu.size(); ++k) {
    const TimeNs start = std::max(a, imu[k].stamp), end = std::min(b, imu[k + 1].stamp);
    if (end <= start) continue;
    R_a_b = R_a_b * expSo3((0.5 * (imu[k].gyro + imu[k + 1].gyro) - bias) * toSeconds(end - start));
  }
  return R_a_b.normalized();
}

TEST(RealImages, RelativeRotationsAgreeWithTheGyro) {
  const std::string path = kData + "euroc_mh01/euroc_mh01.bag";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "no recording at " << path;
  const CameraModel camera(CameraModel::Distortion::kRadTan, {458.654, 457.296, 367.215, 248.375},
                           {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}, 752, 480);
  Eigen::Matrix3d R_imu_camera;
  R_imu_camera << 0.0148655, -0.9998809, 0.0041403, 0.9995572, 0.0149672, 0.0257155, -0.0257744, 0.0037562, 0.9996607;
  const Eigen::Quaterniond q_I_C = Eigen::Quaterniond(R_imu_camera).normalized();
  const Recording recording = readEuroc(path);
  const std::vector<ImageFrame>& images = recording.images;
  ASSERT_EQ(images.size(), 280U);

  FeatureTracker tracker(camera, {});
  std::vector<std::vector<TrackObservation>> tracks;
  for (const ImageFrame& image : images) tracks.push_back(tracker.track(image));
  constexpr std::size_t kStep = 3;                                    // 0.15 s
  std::vector<std::pair<std::size_t, Eigen::Quaterniond>> rotations;  // R_a_b in the IMU frame
  for (std::size_t i = 0; i + kStep < images.size(); ++i) {
    const auto rotation = relativeRotation(tracks[i], tracks[i + kStep], camera);
    if (rotation) rotations.emplace_back(i, q_I_C * rotation->R_b_a.conjugate() * q_I_C.conjugate());
  }
  EXPECT_GE(rotations.size(), 270U);

  // The gyro's bias is not known beforehand; the mean disagreement gives it.
  const auto disagreement = [&](const std::pair<std::size_t, Eigen::Quaterniond>& rotation,
                                const Eigen::Vector3d& bias) {
    const TimeNs a = images[rotation.first].stamp, b = images[rotation.first + kStep].stamp;
    return Eigen::Vector3d(logSo3(rotation.second.conjugate() * integrateGyro(recording.imu, a, b, bias)));
  };
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
  for (const auto& rotation : rotations) {
    bias += disagreement(rotation, Eigen::Vector3d::Zero()) / (0.05 * kStep) / static_cast<double>(rotations.size());
  }
  EXPECT_LT((bias - Eigen::Vector3d(-0.0022, 0.0208, 0.0758)).norm(), 0.01);  // the dataset's own estimate
  std::vector<double> errors;
  for (const auto& rotation : rotations) errors.push_back(disagreement(rotation, bias).norm());
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() / 2], 2e-3);
  EXPECT_LT(errors[errors.size() * 9 / 10], 5e-3);
}

}  // namespace
}  // namespace cocalib
