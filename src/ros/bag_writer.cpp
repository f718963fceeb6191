#include "cocalib/ros/bag_writer.h"

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/image_encodings.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

void setHeader(std_msgs::Header& header, TimeNs stamp, const std::string& frame) {
  header.stamp = toRosTime(stamp);
  header.frame_id = frame;
}

}  // namespace

BagWriter::BagWriter(const std::string& path) : path_(path), partial_path_(path + ".partial") {
  try {
    bag_.open(partial_path_, rosbag::bagmode::Write);
    bag_.setChunkThreshold(4U << 20U);
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(path_ + ": cannot be written (" + error.what() + "); choose a directory that exists");
  }
}

BagWriter::~BagWriter() {
  if (!finished_) abandon();
}

void BagWriter::abandon() noexcept {
  try {
    bag_.close();
  } catch (const std::exception&) {
    // The file is deleted next: what could not be written does not matter.
  }
  std::remove(partial_path_.c_str());
}

template <typename Message>
void BagWriter::write(TimeNs received, const Message& message, const std::string& topic) {
  try {
    bag_.write(topic, toRosTime(received), message);
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(path_ + ": " + error.what() + "; is the disk full?");
  }
}

void BagWriter::writeImu(TimeNs received, const ImuSample& sample, const std::string& topic, const std::string& frame) {
  sensor_msgs::Imu message;
  setHeader(message.header, sample.stamp, frame);
  message.orientation.w = 1.0;
  message.orientation_covariance[0] = -1.0;  // by definition of the message: no orientation is measured
  message.angular_velocity.x = sample.gyro.x();
  message.angular_velocity.y = sample.gyro.y();
  message.angular_velocity.z = sample.gyro.z();
  message.linear_acceleration.x = sample.accel.x();
  message.linear_acceleration.y = sample.accel.y();
  message.linear_acceleration.z = sample.accel.z();
  write(received, message, topic);
}

void BagWriter::writeImage(TimeNs received, const ImageFrame& image, const std::string& topic,
                           const std::string& frame) {
  sensor_msgs::Image message;
  setHeader(message.header, image.stamp, frame);
  message.height = static_cast<std::uint32_t>(image.gray.rows);
  message.width = static_cast<std::uint32_t>(image.gray.cols);
  message.encoding = sensor_msgs::image_encodings::MONO8;
  message.step = message.width;
  message.data.resize(static_cast<std::size_t>(message.step) * message.height);
  for (int row = 0; row < image.gray.rows; ++row) {
    std::memcpy(message.data.data() + static_cast<std::size_t>(row) * message.step, image.gray.ptr(row), message.step);
  }
  write(received, message, topic);
}

void BagWriter::writeCompressedImage(TimeNs received, TimeNs stamp, const std::vector<std::uint8_t>& data,
                                     const std::string& format, const std::string& topic, const std::string& frame) {
  sensor_msgs::CompressedImage message;
  setHeader(message.header, stamp, frame);
  message.format = "mono8; " + format + " compressed ";  // as compressed_image_transport writes it
  message.data = data;
  write(received, message, topic);
}

void BagWriter::writeCameraInfo(TimeNs received, TimeNs stamp, const CameraModel& camera, const std::string& topic,
                                const std::string& frame) {
  sensor_msgs::CameraInfo message;
  setHeader(message.header, stamp, frame);
  message.height = static_cast<std::uint32_t>(camera.height());
  message.width = static_cast<std::uint32_t>(camera.width());
  switch (camera.distortion()) {
    case CameraModel::Distortion::kEquidistant:
      message.distortion_model = "equidistant";
      break;
    case CameraModel::Distortion::kRational:
      message.distortion_model = "rational_polynomial";
      break;
    case CameraModel::Distortion::kRadTan:
      message.distortion_model = "plumb_bob";
      break;
  }
  message.D = camera.coefficients();
  // plumb_bob has five coefficients by definition.
  if (message.distortion_model == "plumb_bob") message.D.resize(5, 0.0);
  const Eigen::Vector4d& k = camera.intrinsics();
  message.K = {k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0};
  message.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  message.P = {k[0], 0.0, k[2], 0.0, 0.0, k[1], k[3], 0.0, 0.0, 0.0, 1.0, 0.0};
  write(received, message, topic);
}

void BagWriter::writeCloud(TimeNs received, const sensor_msgs::PointCloud2& cloud, const std::string& topic) {
  write(received, cloud, topic);
}

void BagWriter::finish() {
  try {
    bag_.close();
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(path_ + ": " + error.what() + "; is the disk full?");
  }
  if (std::rename(partial_path_.c_str(), path_.c_str()) != 0) {
    throw std::runtime_error(path_ + ": cannot be given its name: " + std::strerror(errno));
  }
  finished_ = true;
}

}  // namespace cocalib
