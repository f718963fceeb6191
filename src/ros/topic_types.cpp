#include "cocalib/ros/topic_types.h"

#include <ros/master.h>
#include <ros/names.h>

#include <algorithm>
#include <string>

namespace cocalib {

std::vector<Finding> findWrongTypes(const RigConfig& rig) {
  std::vector<Finding> findings;
  ros::master::V_TopicInfo published;
  if (!ros::master::getTopics(published)) return findings;
  const auto look = [&](const std::string& section, const std::string& topic, const std::vector<std::string>& fitting) {
    for (const ros::master::TopicInfo& info : published) {
      const bool fits = info.datatype == "*" ||  // a relay that has relayed nothing yet
                        std::find(fitting.begin(), fitting.end(), info.datatype) != fitting.end();
      if (info.name != ros::names::resolve(topic) || fits) continue;
      findings.push_back({section + " silent", topic + ": carries " + info.datatype + ", needed is " + fitting.front(),
                          "correct " + section + ": topic in the rig file (rostopic list shows what there is)",
                          Finding::Weight::kError});
    }
  };
  look("imu", rig.imu.topic, {"sensor_msgs/Imu"});
  if (rig.camera) look("camera", rig.camera->topic, {"sensor_msgs/Image", "sensor_msgs/CompressedImage"});
  if (rig.lidar) look("lidar", rig.lidar->topic, {"sensor_msgs/PointCloud2"});
  return findings;
}

}  // namespace cocalib
