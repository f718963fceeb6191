#include <nodelet/nodelet.h>

#include <exception>
#include <memory>
#include <pluginlib/class_list_macros.hpp>
#include <vector>

#include "cocalib/ros/cloud_messages.h"
#include "cocalib/ros/lidar_pipeline.h"
#include "cocalib/ros/marker_messages.h"
#include "cocalib/ros/nodelet_support.h"
#include "cocalib/ros/sensor_session.h"

namespace cocalib {

/// IMU and sweeps in; lidar keyframes, the lidar's own estimate and the deskewed sweeps out; every decision is
/// LidarInertialCalibrator's.
class LidarInertialNodelet : public nodelet::Nodelet {
 public:
  ~LidarInertialNodelet() override {
    for (ros::Subscriber& subscriber : subscribers_) subscriber.shutdown();
    flush_service_.shutdown();
    if (session_) session_->stop();
    map_publisher_.shutdown();  // its subscribers' coming uses the session
  }

 private:
  using Session = SensorSession<LidarPipeline, LidarKeyframeMsg, SensorPart::kLidar>;
  static constexpr std::size_t kCloudQueue = 50;  // five seconds
  static constexpr double kMapPeriodS = 1.0;

  void onInit() override try {
    ros::NodeHandle& nh = getNodeHandle();
    ros::NodeHandle& private_nh = getPrivateNodeHandle();
    const RigConfig rig = loadRigOfNode(private_nh);
    if (rig.lidar) {
      cloud_publisher_ = private_nh.advertise<sensor_msgs::PointCloud2>("points_deskewed", 5);
      raw_publisher_ = private_nh.advertise<sensor_msgs::PointCloud2>("points_raw", 5);
      patch_publisher_ = nh.advertise<visualization_msgs::MarkerArray>("markers", 5);
      session_ = std::make_unique<Session>(private_nh, rig, kCloudQueue);
      advertiseMap(private_nh);
      // Subscribe last: callbacks use everything above.
      subscribers_ = {nh.subscribe(rig.imu.topic, 5000, &Session::addImu, session_.get()),
                      nh.subscribe("estimate", 10, &Session::setJoint, session_.get()),
                      nh.subscribe("control", 10, &Session::obey, session_.get()),
                      nh.subscribe(rig.lidar->topic, 50, &LidarInertialNodelet::onCloud, this)};
    } else {
      NODELET_INFO("the rig has no lidar: nothing to do here");
    }
    flush_service_ = advertiseTrigger(private_nh, "flush", [this](std::string*) {
      if (session_) session_->flush();
      return true;
    });
  } catch (const std::exception& error) {
    endOnError(getName(), error.what());
  }

  /// Who comes late, when there may be no more sweeps, gets the map as it is.
  void advertiseMap(ros::NodeHandle nh) {
    const ros::SubscriberStatusCallback on_subscriber = [this](const ros::SingleSubscriberPublisher&) {
      session_->withPipeline([this](LidarPipeline& pipeline) {
        const std::optional<DeskewedCloud> cloud = pipeline.calibrator().deskewedCloud();
        if (cloud) publishMap(pipeline.calibrator(), cloud->stamp);
      });
    };
    map_publisher_ = nh.advertise<sensor_msgs::PointCloud2>("map", 1, on_subscriber, ros::SubscriberStatusCallback());
  }

  void onCloud(const sensor_msgs::PointCloud2ConstPtr& msg) {
    if (raw_publisher_.getNumSubscribers() > 0) raw_publisher_.publish(msg);
    session_->addData([this, msg](LidarPipeline& pipeline) {
      return pipeline.addCloud(*msg, [&] { publishClouds(pipeline.calibrator()); });
    });
  }

  void publishClouds(const LidarInertialCalibrator& calibrator) {
    const bool cloud_wanted = cloud_publisher_.getNumSubscribers() > 0;
    const bool map_wanted = map_publisher_.getNumSubscribers() > 0;
    const bool patches_wanted = patch_publisher_.getNumSubscribers() > 0;
    if (!cloud_wanted && !map_wanted && !patches_wanted) return;
    const std::optional<DeskewedCloud> cloud = calibrator.deskewedCloud();
    if (!cloud || cloud->stamp == last_cloud_) return;
    last_cloud_ = cloud->stamp;
    const std::vector<PlanePatch> patches = fitPatches(cloud->points_W, cloud->plane);
    if (cloud_wanted) {
      const std::vector<float> distances = distancesToPatches(cloud->points_W, cloud->plane, patches);
      cloud_publisher_.publish(toCloudMsg(*cloud, distances, FrameNames().world));
    }
    if (std::abs(toSeconds(cloud->stamp - last_map_)) < kMapPeriodS) return;
    last_map_ = cloud->stamp;
    if (patches_wanted) patch_publisher_.publish(toPatchMarkers(patches, cloud->stamp, FrameNames().world));
    if (map_wanted) publishMap(calibrator, cloud->stamp);
  }

  void publishMap(const LidarInertialCalibrator& calibrator, TimeNs stamp) {
    map_publisher_.publish(toCloudMsg(calibrator.map(), stamp, FrameNames().world));
  }

  ros::Publisher cloud_publisher_, raw_publisher_, map_publisher_, patch_publisher_;
  TimeNs last_cloud_ = 0, last_map_ = 0;  // used by the session's thread only
  std::unique_ptr<Session> session_;
  std::vector<ros::Subscriber> subscribers_;
  ros::ServiceServer flush_service_;
};

}  // namespace cocalib

PLUGINLIB_EXPORT_CLASS(cocalib::LidarInertialNodelet, nodelet::Nodelet)
