#include "cocalib/ros/nodelet_support.h"

#include <ros/console.h>
#include <ros/init.h>

#include <stdexcept>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/camera_model_source.h"

namespace cocalib {
namespace {

constexpr int kImageQueue = 100;  // two seconds of a fast camera

}  // namespace

RigConfig loadRigOfNode(const ros::NodeHandle& private_nh) {
  std::string path;
  if (!private_nh.getParam("rig", path) || path.empty()) {
    throw std::runtime_error(private_nh.resolveName("rig") + ": parameter missing; set it to the path of the rig file");
  }
  RigConfig rig = loadRigFile(path);
  const std::string earlier = private_nh.param<std::string>("initial_guess", "");
  if (!earlier.empty()) goOnFrom(earlier, &rig);
  return rig;
}

FrameNames frameNamesOf(const RigConfig& rig) {
  FrameNames frames;
  frames.imu = rig.imu.frame;
  if (rig.camera) frames.camera = rig.camera->frame;
  if (rig.lidar) frames.lidar = rig.lidar->frame;
  return frames;
}

void endOnError(const std::string& name, const std::string& what) {
  ROS_FATAL("%s: %s", name.c_str(), what.c_str());
  ros::requestShutdown();
}

ros::Subscriber subscribeImages(ros::NodeHandle nh, const std::string& topic,
                                const std::function<void(const sensor_msgs::ImageConstPtr&)>& on_image,
                                const std::function<void(const sensor_msgs::CompressedImageConstPtr&)>& on_compressed) {
  if (isCompressedTopic(topic)) {
    return nh.subscribe<sensor_msgs::CompressedImage>(
        topic, kImageQueue, boost::function<void(const sensor_msgs::CompressedImageConstPtr&)>(on_compressed));
  }
  return nh.subscribe<sensor_msgs::Image>(topic, kImageQueue,
                                          boost::function<void(const sensor_msgs::ImageConstPtr&)>(on_image));
}

ros::ServiceServer advertiseTrigger(ros::NodeHandle nh, const std::string& name,
                                    const std::function<bool(std::string* words)>& act) {
  using Request = std_srvs::Trigger::Request;
  using Response = std_srvs::Trigger::Response;
  const boost::function<bool(Request&, Response&)> answer = [act](Request&, Response& response) {
    response.success = act(&response.message);
    return true;
  };
  return nh.advertiseService<Request, Response>(name, answer);
}

void logNotices(Notices* notices) {
  for (const Notice& notice : notices->take()) {
    if (notice.warning)
      ROS_WARN("%s", notice.text.c_str());
    else
      ROS_INFO("%s", notice.text.c_str());
  }
}

}  // namespace cocalib
