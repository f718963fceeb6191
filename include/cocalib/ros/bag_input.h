#pragma once

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/io/rig_config.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// A bag that holds what a rig file names, opened for reading in order of recording. Not thread-safe.
class BagInput {
 public:
  enum class Stream { kImu, kImage, kCompressedImage, kCloud, kCameraInfo };

  /// @param start_s     seconds of the bag to skip
  /// @param duration_s  seconds to read; nothing: to the end
  /// @throws std::runtime_error with one line that says which file or topic, why, and what to do
  BagInput(const std::string& file, const RigConfig& rig, double start_s = 0.0, std::optional<double> duration_s = {});

  /// Which of the rig's streams a message of view() belongs to.
  Stream streamOf(const rosbag::MessageInstance& message) const;

  /// Messages of the rig's sensors.
  rosbag::View& view() { return *view_; }

  /// The rig's camera model, from the rig file or from the first camera_info in the bag; nothing without a camera.
  /// @throws std::runtime_error as above
  std::optional<CameraModel> cameraModel() const;

  /// Names in the bag of all topics the rig uses, camera_info included.
  std::vector<std::string> topics() const;
  const rosbag::Bag& bag() const { return bag_; }
  /// First and last instant of recording that view() covers.
  ros::Time begin() const { return begin_; }
  ros::Time end() const { return end_; }

 private:
  struct Topic {
    std::string name, type;
  };
  std::string findTopic(const std::string& name, const std::vector<std::string>& types, const char* part) const;
  void findSensorTopics();
  void openSection(double start_s, std::optional<double> duration_s);

  std::string file_;
  const RigConfig rig_;
  rosbag::Bag bag_;
  std::vector<Topic> in_bag_;
  std::string imu_topic_, camera_topic_, info_topic_, lidar_topic_;
  ros::Time begin_, end_;
  std::unique_ptr<rosbag::View> view_;  // after bag_, which it reads
};

}  // namespace cocalib
