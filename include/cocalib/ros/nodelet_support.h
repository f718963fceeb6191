#pragma once

#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/subscriber.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/Trigger.h>

#include <functional>
#include <string>

#include "cocalib/io/rig_config.h"
#include "cocalib/ros/estimate_conversions.h"
#include "cocalib/ros/notices.h"

namespace cocalib {

/// The rig file that the private parameter `rig` names, with the earlier result that `initial_guess` may name.
/// @throws std::runtime_error with one line if the parameter is missing or the file is refused
RigConfig loadRigOfNode(const ros::NodeHandle& private_nh);

FrameNames frameNamesOf(const RigConfig& rig);

/// Logs a configuration error and asks the process to end: a calibrator that cannot work must not look alive. The exit
/// code of the manager is not changed by it; the log line is the message.
void endOnError(const std::string& name, const std::string& what);

/// Subscribes to the rig's pictures, whichever of the two types they come in.
ros::Subscriber subscribeImages(ros::NodeHandle nh, const std::string& topic,
                                const std::function<void(const sensor_msgs::ImageConstPtr&)>& on_image,
                                const std::function<void(const sensor_msgs::CompressedImageConstPtr&)>& on_compressed);

/// A std_srvs/Trigger service. @param act  returns whether it worked and fills the words for the caller
ros::ServiceServer advertiseTrigger(ros::NodeHandle nh, const std::string& name,
                                    const std::function<bool(std::string* words)>& act);

/// Puts new lines of a pipeline into the log.
void logNotices(Notices* notices);

}  // namespace cocalib
