#include <cocalib/CalibrationConfig.h>
#include <dynamic_reconfigure/server.h>
#include <nodelet/nodelet.h>
#include <std_msgs/String.h>

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <string>

#include "cocalib/ros/camera_model_source.h"
#include "cocalib/ros/fusion_session.h"
#include "cocalib/ros/nodelet_support.h"

namespace cocalib {

/// Keyframes of both calibrators in, the joint estimate out; every decision is CoCalibrationFuser's.
class CoCalibrationFuserNodelet : public nodelet::Nodelet {
 public:
  ~CoCalibrationFuserNodelet() override {
    for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
    for (ros::ServiceServer& service : services_) service.shutdown();
  }

 private:
  void onInit() override try {
    rig_ = loadRigOfNode(getPrivateNodeHandle());
    control_ = getNodeHandle().advertise<std_msgs::String>("control", 10);
    camera_source_ = std::make_unique<CameraModelSource>(
        getNodeHandle(), rig_, [this](const std::optional<CameraModel>& camera) { start(camera); });
    advertiseServices();
  } catch (const std::exception& error) {
    endOnError(getName(), error.what());
  }

  void start(const std::optional<CameraModel>& camera) try {
    ros::NodeHandle& nh = getNodeHandle();
    const std::string output = getPrivateNodeHandle().param<std::string>("output", "output");
    session_ = std::make_unique<FusionSession>(nh, getPrivateNodeHandle(), rig_, output, camera);
    FusionSession* session = session_.get();

    // Subscribe last: callbacks use everything above.
    subscribers_ = {nh.subscribe(rig_.imu.topic, 5000, &FusionSession::addImu, session),
                    nh.subscribe("visual_inertial/keyframes", 500, &FusionSession::addVisual, session),
                    nh.subscribe("lidar_inertial/keyframes", 200, &FusionSession::addLidar, session),
                    nh.subscribe("visual_inertial/estimate", 20, &FusionSession::setVisualEstimate, session),
                    nh.subscribe("lidar_inertial/estimate", 20, &FusionSession::setLidarEstimate, session)};
    if (rig_.camera) {
      subscribers_.push_back(subscribeImages(
          nh, rig_.camera->topic, [session](const sensor_msgs::ImageConstPtr& msg) { session->addImage(msg); },
          [session](const sensor_msgs::CompressedImageConstPtr& msg) { session->addCompressed(msg); }));
      if (!rig_.camera->model)
        subscribers_.push_back(nh.subscribe(rig_.camera->info_topic, 5, &FusionSession::addCameraInfo, session));
    }
    if (rig_.lidar) subscribers_.push_back(nh.subscribe(rig_.lidar->topic, 50, &FusionSession::addCloud, session));
    settings_ = std::make_unique<dynamic_reconfigure::Server<CalibrationConfig>>(getPrivateNodeHandle());
    settings_->setCallback([session](const CalibrationConfig& config, std::uint32_t) {
      session->configure({config.publish_tf, config.freeze_when_converged, config.status_period});
    });
  } catch (const std::exception& error) {
    endOnError(getName(), error.what());
  }

  /// They answer from the start on, so that a user who calls one too early learns what is missing.
  void advertiseServices() {
    const auto begin = [this](std::string* words) {
      tell("start");
      session_->restart();
      *words = "started anew";
      return true;
    };
    advertise("save", [this](std::string* words) { return session_->save(words); });
    advertise("start", begin);
    advertise("reset", begin);
    advertise("resume", begin);
    advertise("freeze", [this](std::string* words) { return session_->freeze(words); });
    advertise("flush", [this](std::string*) { return session_->flush(), true; });
    advertise("stop", [this](std::string* words) {
      tell("stop");
      session_->finish();
      *words = "stopped; the estimate is final, save writes it";
      return true;
    });
  }

  /// A service that acts once there is a session; before, it says what the session waits for.
  void advertise(const std::string& name, std::function<bool(std::string* words)> act) {
    services_.push_back(advertiseTrigger(getNodeHandle(), name, [this, act](std::string* words) {
      if (session_) return act(words);
      *words = "nothing is running yet: " + camera_source_->missing();
      return false;
    }));
  }

  /// To the two calibrators.
  void tell(const char* word) {
    std_msgs::String msg;
    msg.data = word;
    control_.publish(msg);
  }

  RigConfig rig_;
  ros::Publisher control_;
  std::unique_ptr<FusionSession> session_;
  std::unique_ptr<CameraModelSource> camera_source_;
  std::vector<ros::Subscriber> subscribers_;
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<dynamic_reconfigure::Server<CalibrationConfig>> settings_;  // last: its callback uses session_
};

}  // namespace cocalib

PLUGINLIB_EXPORT_CLASS(cocalib::CoCalibrationFuserNodelet, nodelet::Nodelet)
