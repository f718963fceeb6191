#include <nodelet/nodelet.h>

#include <exception>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <vector>

#include "cocalib/ros/camera_model_source.h"
#include "cocalib/ros/camera_pipeline.h"
#include "cocalib/ros/nodelet_support.h"
#include "cocalib/ros/sensor_session.h"

namespace cocalib {

/// IMU and pictures in, visual keyframes and the camera's own estimate out; every decision is
/// VisualInertialCalibrator's.
class VisualInertialNodelet : public nodelet::Nodelet {
 public:
  ~VisualInertialNodelet() override {
    for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
    flush_service_.shutdown();
  }

 private:
  using Session = SensorSession<CameraPipeline, VisualKeyframeMsg, SensorPart::kCamera>;
  static constexpr std::size_t kImageQueue = 150;  // three seconds of a 50 Hz camera

  void onInit() override try {
    rig_ = loadRigOfNode(getPrivateNodeHandle());
    if (!rig_.camera) NODELET_INFO("the rig has no camera: nothing to do here");
    camera_source_ = std::make_unique<CameraModelSource>(
        getNodeHandle(), rig_, [this](const std::optional<CameraModel>& camera) { start(camera); });
    flush_service_ = advertiseTrigger(getPrivateNodeHandle(), "flush", [this](std::string* words) {
      *words = camera_source_->missing();
      if (session_) session_->flush();
      return words->empty();
    });
  } catch (const std::exception& error) {
    endOnError(getName(), error.what());
  }

  void start(const std::optional<CameraModel>& camera) try {
    ros::NodeHandle& nh = getNodeHandle();
    if (camera) {
      session_ = std::make_unique<Session>(getPrivateNodeHandle(), rig_, kImageQueue, *camera);
      Session* session = session_.get();
      // Subscribe last: callbacks use everything above.
      subscribers_ = {nh.subscribe(rig_.imu.topic, 5000, &Session::addImu, session),
                      nh.subscribe("estimate", 10, &Session::setJoint, session),
                      nh.subscribe("control", 10, &Session::obey, session)};
      const auto take = [session](const auto& msg) {
        session->addData([msg](CameraPipeline& pipeline) { return pipeline.addImage(*msg); });
      };
      subscribers_.push_back(subscribeImages(nh, rig_.camera->topic, take, take));
    }
  } catch (const std::exception& error) {
    endOnError(getName(), error.what());
  }

  RigConfig rig_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<CameraModelSource> camera_source_;
  std::vector<ros::Subscriber> subscribers_;
  ros::ServiceServer flush_service_;
};

}  // namespace cocalib

PLUGINLIB_EXPORT_CLASS(cocalib::VisualInertialNodelet, nodelet::Nodelet)
