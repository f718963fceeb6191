#include "cocalib/ros/live_display.h"

#include <cv_bridge/cv_bridge.h>
#include <ros/single_subscriber_publisher.h>
#include <sensor_msgs/Image.h>

#include <boost/make_shared.hpp>

#include "cocalib/estimation/observability.h"
#include "cocalib/ros/board_view_markers.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/marker_messages.h"

namespace cocalib {
namespace {

constexpr TimeNs kBoardsNs = 4'000'000'000;  // scenes are as old as that when their state comes

sensor_msgs::ImagePtr toImageMsg(const cv::Mat& picture, TimeNs stamp, const std::string& frame) {
  std_msgs::Header header;
  header.stamp = toRosTime(stamp);
  header.frame_id = frame;
  return cv_bridge::CvImage(header, "bgr8", picture).toImageMsg();
}

}  // namespace

LiveDisplay::LiveDisplay(ros::NodeHandle nh, const RigConfig& rig, const FrameNames& frames)
    : rig_(rig),
      frames_(frames),
      newest_(rig, SceneCollector::Keep::kNewest),
      spread_(rig, SceneCollector::Keep::kSpread),
      worker_({1, 1, 1}) {
  advertise(nh);
}

LiveDisplay::~LiveDisplay() {
  worker_.stop();
  overlay_publisher_.shutdown();  // their subscribers' coming uses all of this
  convergence_publisher_.shutdown();
  marker_publisher_.shutdown();
}

void LiveDisplay::advertise(ros::NodeHandle nh) {
  const ros::SubscriberStatusCallback on_overlay = [this](const ros::SingleSubscriberPublisher&) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      last_drawn_ = 0;  // draw it once more
    }
    worker_.post(kOverlay, [this] { drawNewestOverlay(); });
  };
  const ros::SubscriberStatusCallback on_convergence = [this](const ros::SingleSubscriberPublisher&) {
    worker_.post(kConvergence, [this] { publishConvergence(); });
  };
  const ros::SubscriberStatusCallback on_markers = [this](const ros::SingleSubscriberPublisher& subscriber) {
    const std::lock_guard<std::mutex> lock(mutex_);
    subscriber.publish(markers_);
  };
  const ros::SubscriberStatusCallback on_leaving;
  overlay_publisher_ = nh.advertise<sensor_msgs::Image>("overlay", 2, on_overlay, on_leaving);
  convergence_publisher_ = nh.advertise<sensor_msgs::Image>("convergence", 1, on_convergence, on_leaving);
  marker_publisher_ = nh.advertise<visualization_msgs::MarkerArray>("markers", 5, on_markers, on_leaving);
}

void LiveDisplay::setCamera(const std::optional<CameraModel>& camera) {
  const std::lock_guard<std::mutex> lock(mutex_);
  camera_ = camera;
}

void LiveDisplay::addImu(const sensor_msgs::Imu& msg) {
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_.addImu(msg);
  spread_.addImu(msg);
}

void LiveDisplay::addImage(const sensor_msgs::ImageConstPtr& msg) {
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_.addImage(msg);
  spread_.addImage(msg);
}

void LiveDisplay::addImage(const sensor_msgs::CompressedImageConstPtr& msg) {
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_.addImage(msg);
  spread_.addImage(msg);
}

void LiveDisplay::addCloud(const sensor_msgs::PointCloud2ConstPtr& msg) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    newest_.addCloud(msg);
    spread_.addCloud(msg);
  }
  if (overlay_publisher_.getNumSubscribers() > 0) worker_.post(kOverlay, [this] { drawNewestOverlay(); });
  if (marker_publisher_.getNumSubscribers() > 0) worker_.post(kBoard, [this] { publishBoardViews(); });
}

void LiveDisplay::addBoard(TimeNs stamp, const BoardObservation& corners) {
  const std::lock_guard<std::mutex> lock(mutex_);
  boards_[stamp] = corners;
  boards_.erase(boards_.begin(), boards_.lower_bound(stamp - kBoardsNs));
}

void LiveDisplay::addState(const NavState& state) {
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_.addState(state);
  spread_.addState(state);
}

void LiveDisplay::setEstimate(const CalibrationEstimate& estimate, const std::optional<Pose>& T_W_B) {
  const std::lock_guard<std::mutex> lock(mutex_);
  estimate_ = estimate;
  T_W_B_ = T_W_B;
  if (estimate.camera.valid || estimate.lidar.valid) log_.add(estimate);
}

void LiveDisplay::setHint(const std::string& words, const std::optional<MotionHint>& hint) {
  visualization_msgs::MarkerArray markers;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    markers = toMarkers(estimate_, T_W_B_, rig_.target, frames_);
  }
  addHint(words, hint, frames_, &markers);
  marker_publisher_.publish(markers);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    markers_ = std::move(markers);
  }
  worker_.post(kConvergence, [this] { publishConvergence(); });
}

void LiveDisplay::reset() {
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_.clear();
  spread_.clear();
  log_.clear();
  estimate_ = CalibrationEstimate();
  T_W_B_.reset();
  boards_.clear();
  last_drawn_ = last_viewed_ = 0;
}

RunResult LiveDisplay::result(const CalibrationEstimate& estimate) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  RunResult result;
  result.estimate = estimate;
  result.log = log_;
  result.log.add(estimate);
  result.camera = camera_;
  result.T_W_B = T_W_B_;
  if (rig_.lidar && camera_) {
    result.scene = spread_.best(estimate.calibration, *camera_, T_W_B_);
    result.scenes = spread_.some(kReportScenes);
  }
  return result;
}

void LiveDisplay::drawNewestOverlay() {
  std::optional<OverlayScene> scene;
  std::optional<CameraModel> camera;
  OverlayCalibration with;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!camera_) return;
    scene = newest_.newest();
    if (!scene || scene->image.stamp == last_drawn_) return;
    last_drawn_ = scene->image.stamp;
    camera = camera_;
    const bool known = isSeen(estimate_.camera) && isSeen(estimate_.lidar);
    with.calibration =
        known ? estimate_.calibration : nominalCalibration(rig_.guess_T_imu_camera, rig_.guess_T_imu_lidar);
    with.T_W_B = T_W_B_;
    with.caption = known ? toString(estimate_.status) : "not calibrated yet";
  }
  if (scene->image.gray.cols != camera->width() || scene->image.gray.rows != camera->height()) return;
  const cv::Mat picture = drawOverlay(*scene, with, *camera, rig_.target);
  overlay_publisher_.publish(toImageMsg(picture, scene->image.stamp, frames_.camera));
}

void LiveDisplay::publishConvergence() {
  if (convergence_publisher_.getNumSubscribers() == 0) return;
  ConvergenceLog log;
  TimeNs stamp = 0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    log = log_;
    stamp = estimate_.stamp;
  }
  convergence_publisher_.publish(toImageMsg(log.draw({800, 600}), stamp, frames_.imu));
}

void LiveDisplay::publishBoardViews() {
  std::optional<OverlayScene> scene;
  std::optional<CameraModel> camera;
  BoardObservation corners;
  Calibration calibration;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!camera_ || !rig_.target || !isSeen(estimate_.camera) || !isSeen(estimate_.lidar)) return;
    scene = newest_.newest([this](TimeNs stamp) { return stamp > last_viewed_ && boards_.count(stamp) > 0; });
    if (!scene) return;
    last_viewed_ = scene->image.stamp;
    corners = boards_.at(scene->image.stamp);
    camera = camera_;
    calibration = estimate_.calibration;
  }
  const std::optional<BoardViews> views =
      viewBoard(*scene, corners, calibration, *camera, *rig_.target, rig_.lidar->range_noise_m);
  if (views) marker_publisher_.publish(toBoardViewMarkers(*views, *rig_.target, frames_.camera));
}

}  // namespace cocalib
