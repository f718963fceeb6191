#include "cocalib/ros/board_calibration.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/ros/camera_info.h"
#include "cocalib/ros/image_reader.h"
#include "cocalib/ros/point_cloud_reader.h"
#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

constexpr TimeNs kMaxStampDifference = 50'000'000;  // within one period of either sensor
constexpr TimeNs kMinViewInterval = 500'000'000;    // a board at rest tells nothing new sooner

/// One topic of the bag: where its messages are, by header stamp.
template <typename Message>
std::vector<std::pair<TimeNs, ros::Time>> stampsOf(const rosbag::Bag& bag, const std::string& topic) {
  std::vector<std::pair<TimeNs, ros::Time>> stamps;
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  for (const rosbag::MessageInstance& instance : view) {
    const auto message = instance.instantiate<Message>();
    if (message == nullptr) continue;
    stamps.emplace_back(static_cast<TimeNs>(message->header.stamp.toNSec()), instance.getTime());
  }
  return stamps;
}

/// The message of a topic that was recorded at `time`.
template <typename Message>
boost::shared_ptr<Message> messageAt(const rosbag::Bag& bag, const std::string& topic, ros::Time time) {
  rosbag::View view(bag, rosbag::TopicQuery(topic), time, time);
  for (const rosbag::MessageInstance& instance : view) {
    if (const auto message = instance.instantiate<Message>()) return message;
  }
  return nullptr;
}

/// Views of board and plate out of a bag.
class BoardBag {
 public:
  BoardBag(const std::string& file, const RigConfig& rig) : file_(file), rig_(rig), clouds_(*rig.lidar) {
    try {
      bag_.open(file, rosbag::bagmode::Read);
    } catch (const rosbag::BagException& error) {
      throw std::runtime_error(file + ": cannot be read as a bag (" + error.what() + ")");
    }
    image_stamps_ = stampsOf<sensor_msgs::Image>(bag_, rig_.camera->topic);
    compressed_ = image_stamps_.empty();
    if (compressed_) image_stamps_ = stampsOf<sensor_msgs::CompressedImage>(bag_, rig_.camera->topic);
    if (image_stamps_.empty()) throw missing(rig_.camera->topic, "camera: topic", "pictures");
    cloud_stamps_ = stampsOf<sensor_msgs::PointCloud2>(bag_, rig_.lidar->topic);
    if (cloud_stamps_.empty()) throw missing(rig_.lidar->topic, "lidar: topic", "point clouds");
    camera_ = findCamera();
  }

  BoardCalibration calibrate(const std::function<void(int, int)>& progress) {
    BoardCalibration result;
    std::vector<BoardView> views;
    const auto pairs = pairStamps();
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      ++result.images;
      if (const std::optional<Pose> T_C_B = boardPose(pairs[i].first)) {
        views.push_back({*T_C_B, findPlates(pairs[i].second)});
        ++result.images_with_board;
        ++result.clouds;
        result.clouds_with_plate += views.back().plates.empty() ? 0 : 1;
      }
      if (progress) progress(static_cast<int>(i) + 1, static_cast<int>(pairs.size()));
    }
    if (pairs.empty()) {
      result.reason = "no picture and sweep are within 50 ms of each other: are both stamped by the same clock?";
      return result;
    }
    LidarCameraInitializerParams params;
    params.range_noise_m = rig_.lidar->range_noise_m;
    result.start = initializeLidarCamera(views, *rig_.target, params, &result.reason);
    return result;
  }

 private:
  std::runtime_error missing(const std::string& topic, const char* key, const char* what) const {
    return std::runtime_error(file_ + ": no " + what + " on topic " + topic + "; see 'rosbag info' and set " + key +
                              " in " + rig_.file);
  }

  CameraModel findCamera() const {
    if (rig_.camera->model) return *rig_.camera->model;
    rosbag::View view(bag_, rosbag::TopicQuery(rig_.camera->info_topic));
    std::string problem = "there is none";
    for (const rosbag::MessageInstance& instance : view) {
      const auto info = instance.instantiate<sensor_msgs::CameraInfo>();
      if (info == nullptr) continue;
      if (const auto camera = readCameraInfo(*info, &problem)) return *camera;
    }
    throw std::runtime_error(file_ + ": no usable camera_info on topic " + rig_.camera->info_topic + " (" + problem +
                             "); give model, intrinsics, distortion and resolution in " + rig_.file);
  }

  /// Recording times of pictures and sweeps that belong together.
  std::vector<std::pair<ros::Time, ros::Time>> pairStamps() const {
    std::vector<std::pair<ros::Time, ros::Time>> pairs;
    std::optional<TimeNs> last;
    for (const auto& [image_stamp, image_time] : image_stamps_) {
      if (last && std::abs(image_stamp - *last) < kMinViewInterval) continue;
      const auto* nearest = &cloud_stamps_.front();
      for (const auto& cloud : cloud_stamps_) {
        if (std::abs(cloud.first - image_stamp) < std::abs(nearest->first - image_stamp)) nearest = &cloud;
      }
      if (std::abs(nearest->first - image_stamp) > kMaxStampDifference) continue;
      pairs.emplace_back(image_time, nearest->second);
      last = image_stamp;
    }
    return pairs;
  }

  std::optional<Pose> boardPose(ros::Time time) const {
    std::optional<ImageFrame> image;
    if (compressed_) {
      const auto message = messageAt<sensor_msgs::CompressedImage>(bag_, rig_.camera->topic, time);
      if (message != nullptr) image = readImage(*message, nullptr);
    } else {
      const auto message = messageAt<sensor_msgs::Image>(bag_, rig_.camera->topic, time);
      if (message != nullptr) image = readImage(*message, nullptr);
    }
    if (!image) return std::nullopt;
    // A detector of its own for every picture: the board is somewhere else each time.
    BoardDetector detector(*rig_.target, *camera_, BoardDetector::Params{});
    if (!detector.detect(*image)) return std::nullopt;
    return detector.lastPose();
  }

  std::vector<LidarPlate> findPlates(ros::Time time) {
    std::vector<LidarPlate> plates;
    const auto message = messageAt<sensor_msgs::PointCloud2>(bag_, rig_.lidar->topic, time);
    const auto scan = message == nullptr ? std::nullopt : clouds_.read(*message, nullptr);
    if (!scan) return plates;
    std::vector<Eigen::Vector3f> points_L;  // at rest there is nothing to deskew
    points_L.reserve(scan->points.size());
    for (const LidarPoint& point : scan->points) points_L.push_back(point.p);
    for (const auto& candidate : findBoardCandidates(*scan, points_L, *rig_.target, rig_.lidar->range_noise_m)) {
      plates.push_back(makeLidarPlate(*scan, points_L, candidate));
    }
    return plates;
  }

  const std::string file_;
  const RigConfig& rig_;
  rosbag::Bag bag_;
  PointCloudReader clouds_;
  std::vector<std::pair<TimeNs, ros::Time>> image_stamps_, cloud_stamps_;
  bool compressed_ = false;
  std::optional<CameraModel> camera_;
};

}  // namespace

BoardCalibration calibrateFromBoards(const std::string& bag_file, const RigConfig& rig,
                                     const std::function<void(int, int)>& progress) {
  const auto need = [&](bool there, const char* section) {
    if (!there)
      throw std::runtime_error(rig.file + ": section '" + section + "' is missing; a board calibration needs it");
  };
  need(rig.camera.has_value(), "camera");
  need(rig.lidar.has_value(), "lidar");
  need(rig.target.has_value(), "target");
  return BoardBag(bag_file, rig).calibrate(progress);
}

std::string formatBoardCalibration(const BoardCalibration& calibration) {
  const LidarCameraStart& start = *calibration.start;
  const Pose& T = start.T_lidar_camera;
  const Vector6d& s = start.sigma;
  char text[1200];
  std::snprintf(text, sizeof text,
                "cocalib: 1\n"
                "lidar_camera:                 # p_lidar = T_lidar_camera p_camera; m, rad\n"
                "  T_lidar_camera: {translation: [%.9f, %.9f, %.9f], rotation_xyzw: [%.12f, %.12f, %.12f, %.12f]}\n"
                "  sigma: {translation: [%.6f, %.6f, %.6f], rotation: [%.7f, %.7f, %.7f]}   # 1 sigma, jackknife\n"
                "quality: {board_views: %d, lidar_plane_rms_m: %.5f, outline_rms_m: %.5f}\n",
                T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w(), s[0], s[1], s[2], s[3], s[4], s[5],
                start.used_views, start.plane_rms_m, start.edge_rms_m);
  return text;
}

}  // namespace cocalib
