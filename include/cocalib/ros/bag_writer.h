#pragma once

#include <rosbag/bag.h>

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/ros/point_cloud_writer.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Writes measurements to a bag as the drivers would publish them. The file appears under its name only when it is
/// complete; until then it is NAME.partial, which an abandoned writer deletes. Not thread-safe.
/// `received` is the time the message gets in the bag; it never runs backwards.
class BagWriter {
 public:
  /// @throws std::runtime_error if the file cannot be created
  explicit BagWriter(const std::string& path);
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  // Each throws std::runtime_error when the disk is full or gone.
  void writeImu(TimeNs received, const ImuSample& sample, const std::string& topic, const std::string& frame);
  void writeImage(TimeNs received, const ImageFrame& image, const std::string& topic, const std::string& frame);
  /// @param format  "jpeg" or "png"
  void writeCompressedImage(TimeNs received, TimeNs stamp, const std::vector<std::uint8_t>& data,
                            const std::string& format, const std::string& topic, const std::string& frame);
  void writeCameraInfo(TimeNs received, TimeNs stamp, const CameraModel& camera, const std::string& topic,
                       const std::string& frame);
  void writeCloud(TimeNs received, const sensor_msgs::PointCloud2& cloud, const std::string& topic);

  /// Closes the bag and gives it its name. @throws std::runtime_error
  void finish();

 private:
  template <typename Message>
  void write(TimeNs received, const Message& message, const std::string& topic);
  void abandon() noexcept;

  std::string path_, partial_path_;
  rosbag::Bag bag_;
  bool finished_ = false;
};

}  // namespace cocalib
