#include "cocalib/ros/bag_input.h"

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <map>
#include <stdexcept>

#include "cocalib/ros/camera_info.h"

namespace cocalib {
namespace {

const std::string kImuType = "sensor_msgs/Imu";
const std::string kImageType = "sensor_msgs/Image";
const std::string kCompressedType = "sensor_msgs/CompressedImage";
const std::string kCloudType = "sensor_msgs/PointCloud2";
const std::string kInfoType = "sensor_msgs/CameraInfo";

/// A bag may hold "imu" for what the rig file calls "/imu".
std::string withoutSlash(const std::string& topic) {
  return !topic.empty() && topic.front() == '/' ? topic.substr(1) : topic;
}

void openBag(const std::string& file, rosbag::Bag* bag) {
  try {
    bag->open(file, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    throw std::runtime_error(file + ": the bag has no index (recording was cut off); repair it with rosbag reindex");
  } catch (const rosbag::BagIOException&) {
    throw std::runtime_error(file + ": the bag cannot be read; check the path and the permissions");
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(file + ": not a bag that can be read (" + error.what() + "); check it with rosbag info");
  }
}

}  // namespace

BagInput::BagInput(const std::string& file, const RigConfig& rig, double start_s, std::optional<double> duration_s)
    : file_(file), rig_(rig) {
  openBag(file, &bag_);
  rosbag::View everything(bag_);
  std::map<std::string, std::string> types;
  for (const rosbag::ConnectionInfo* connection : everything.getConnections()) {
    types[connection->topic] = connection->datatype;
  }
  for (const auto& [name, type] : types) in_bag_.push_back({name, type});
  findSensorTopics();
  openSection(start_s, duration_s);
}

std::string BagInput::findTopic(const std::string& name, const std::vector<std::string>& types,
                                const char* part) const {
  const auto isWanted = [&types](const Topic& topic) {
    return std::find(types.begin(), types.end(), topic.type) != types.end();
  };
  std::string candidates;
  for (const Topic& topic : in_bag_) {
    if (withoutSlash(topic.name) == withoutSlash(name)) {
      if (isWanted(topic)) return topic.name;
      throw std::runtime_error(file_ + ": topic " + name + " is of type " + topic.type + ", " + rig_.file +
                               " needs a " + types.front() + " there; correct " + part);
    }
    if (isWanted(topic)) candidates += (candidates.empty() ? "" : ", ") + topic.name;
  }
  throw std::runtime_error(file_ + ": no topic " + name + "; " +
                           (candidates.empty() ? "no other topic of type " + types.front() +
                                                     " either; take that part out of " + rig_.file + " or another bag"
                                               : "of type " + types.front() + " it has " + candidates + "; correct " +
                                                     part + " in " + rig_.file));
}

void BagInput::findSensorTopics() {
  imu_topic_ = findTopic(rig_.imu.topic, {kImuType}, "imu: topic");
  if (rig_.camera) {
    camera_topic_ = findTopic(rig_.camera->topic, {kImageType, kCompressedType}, "camera: topic");
    if (!rig_.camera->model) info_topic_ = findTopic(rig_.camera->info_topic, {kInfoType}, "camera: info_topic");
  }
  if (rig_.lidar) lidar_topic_ = findTopic(rig_.lidar->topic, {kCloudType}, "lidar: topic");
}

void BagInput::openSection(double start_s, std::optional<double> duration_s) {
  const std::vector<std::string> wanted = topics();
  rosbag::View whole(bag_, rosbag::TopicQuery(wanted));
  if (whole.size() == 0)
    throw std::runtime_error(file_ + ": the bag holds no message of the rig's topics; record again");
  const double length_s = (whole.getEndTime() - whole.getBeginTime()).toSec();
  if (start_s > length_s) {
    throw std::runtime_error(file_ + ": the bag is " + std::to_string(length_s) + " s long; choose an earlier --start");
  }
  begin_ = whole.getBeginTime() + ros::Duration(start_s);
  end_ = whole.getEndTime();
  if (duration_s) end_ = std::min(end_, begin_ + ros::Duration(*duration_s));
  view_ = std::make_unique<rosbag::View>(bag_, rosbag::TopicQuery(wanted), begin_, end_);
}

std::vector<std::string> BagInput::topics() const {
  std::vector<std::string> names;
  for (const std::string* name : {&imu_topic_, &camera_topic_, &info_topic_, &lidar_topic_}) {
    if (!name->empty()) names.push_back(*name);
  }
  return names;
}

BagInput::Stream BagInput::streamOf(const rosbag::MessageInstance& message) const {
  const std::string& type = message.getDataType();
  if (type == kImageType) return Stream::kImage;
  if (type == kCompressedType) return Stream::kCompressedImage;
  if (type == kInfoType) return Stream::kCameraInfo;
  return type == kCloudType ? Stream::kCloud : Stream::kImu;
}

std::optional<CameraModel> BagInput::cameraModel() const {
  if (!rig_.camera) return std::nullopt;
  if (rig_.camera->model) return rig_.camera->model;
  rosbag::View view(bag_, rosbag::TopicQuery(info_topic_));
  std::string problem = "there is no message on it";
  for (const rosbag::MessageInstance& message : view) {
    const sensor_msgs::CameraInfo::ConstPtr info = message.instantiate<sensor_msgs::CameraInfo>();
    if (!info) continue;
    if (std::optional<CameraModel> model = readCameraInfo(*info, &problem)) return model;
    break;
  }
  throw std::runtime_error(file_ + ": " + info_topic_ + ": " + problem + "; write model, intrinsics, distortion and " +
                           "resolution into " + rig_.file + " in place of info_topic");
}

}  // namespace cocalib
