#include "cocalib/ros/fusion_session.h"

#include <ros/console.h>

#include <exception>
#include <utility>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/keyframe_conversions.h"
#include "cocalib/ros/nodelet_support.h"
#include "cocalib/ros/result_files.h"

namespace cocalib {
namespace {

// What may wait while a solve of some seconds runs.
constexpr std::size_t kImuQueue = 20'000, kVisualQueue = 1'000, kLidarQueue = 300, kControlQueue = 100;

}  // namespace

FusionSession::FusionSession(ros::NodeHandle nh, ros::NodeHandle private_nh, const RigConfig& rig,
                             const std::string& output, const std::optional<CameraModel>& camera)
    : rig_(rig),
      frames_(frameNamesOf(rig)),
      output_(output),
      publisher_(nh, frames_),
      diagnostics_(nh, private_nh, "cocalib fuser"),
      display_(nh, rig, frames_),
      pipeline_(rig, camera),
      worker_({kImuQueue, kVisualQueue, kLidarQueue, kControlQueue}) {
  prepareOutputDirectory(output_);
  display_.setCamera(camera);
  worker_.post(kControl, [this] { publish(); });
}

FusionSession::~FusionSession() {
  worker_.stop();
  std::string words;
  if (unsaved_ && !save(&words)) ROS_ERROR("%s", words.c_str());
}

void FusionSession::addImu(const sensor_msgs::ImuConstPtr& msg) {
  if (!active_) return;
  display_.addImu(*msg);
  worker_.post(kImu, [this, msg] {
    if (!greeted_) unsaved_ = greeted_ = true;
    if (!pipeline_.addImu(*msg)) return;
    ROS_WARN("the clock was set back: starting over");
    publisher_.reset();
    display_.reset();
    publish();
  });
}

void FusionSession::addVisual(const VisualKeyframeConstPtr& msg) {
  if (!active_) return;
  worker_.post(kVisual, [this, msg] {
    VisualKeyframe keyframe = fromKeyframeMsg(*msg);
    if (!rig_.lidar && keyframe.state) {
      publisher_.broadcastPose(*keyframe.state);
      display_.addState(*keyframe.state);
    }
    pipeline_.addVisual(std::move(keyframe));
    solveIfDue();
  });
}

void FusionSession::addLidar(const LidarKeyframeConstPtr& msg) {
  if (!active_) return;
  worker_.post(kLidar, [this, msg] {
    LidarKeyframe keyframe = fromKeyframeMsg(*msg);
    if (keyframe.state) {
      publisher_.broadcastPose(*keyframe.state);
      display_.addState(*keyframe.state);
    }
    pipeline_.addLidar(std::move(keyframe));
    solveIfDue();
  });
}

void FusionSession::setVisualEstimate(const ExtrinsicEstimateConstPtr& msg) {
  worker_.post(kControl, [this, msg] {
    const bool changed = pipeline_.fuser().setVisualEstimate(fromExtrinsicMsg(*msg, SensorPart::kCamera));
    changed ? publish() : publishDiagnostics();
  });
}

void FusionSession::setLidarEstimate(const ExtrinsicEstimateConstPtr& msg) {
  worker_.post(kControl, [this, msg] {
    const bool changed = pipeline_.fuser().setLidarEstimate(fromExtrinsicMsg(*msg, SensorPart::kLidar));
    changed ? publish() : publishDiagnostics();
  });
}

void FusionSession::addImage(const sensor_msgs::ImageConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (active_ && rig_.lidar) display_.addImage(msg);
}

void FusionSession::addCompressed(const sensor_msgs::CompressedImageConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (active_ && rig_.lidar) display_.addImage(msg);
}

void FusionSession::addCloud(const sensor_msgs::PointCloud2ConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (active_) display_.addCloud(msg);
}

void FusionSession::restart() {
  worker_.post(kControl, [this] {
    pipeline_.reset();
    publisher_.reset();
    display_.reset();
    greeted_ = false;
    publish();
  });
  worker_.drain();
  active_ = true;
}

void FusionSession::finish() {
  active_ = false;
  worker_.post(kControl, [this] {
    pipeline_.fuser().finish();
    unsaved_ = true;
    publish();
  });
  worker_.drain();
}

bool FusionSession::save(std::string* words) {
  // From the worker's thread; after stop() there is no such thread, and none is needed.
  CalibrationEstimate estimate;
  bool fetched = false;
  worker_.post(kControl, [&] {
    estimate = pipeline_.fuser().estimate();
    fetched = true;
  });
  worker_.drain();
  if (!fetched) estimate = pipeline_.fuser().estimate();
  try {
    writeResultFiles(output_, rig_, display_.result(estimate));
  } catch (const std::exception& error) {
    *words = error.what();
    return false;
  }
  unsaved_ = false;
  *words = output_ + "/calibration.yaml";
  ROS_INFO("%swritten: %s", describeResult(rig_, estimate).c_str(), words->c_str());
  return true;
}

void FusionSession::solveIfDue() {
  if (!pipeline_.fuser().wantsSolve() || !pipeline_.fuser().solve()) return;
  unsaved_ = true;
  publish();
}

void FusionSession::publish() {
  const CalibrationEstimate estimate = pipeline_.fuser().estimate();
  const CalibratorDiagnostics diagnostics = pipeline_.diagnostics();
  publisher_.publish(estimate, diagnostics);
  const std::string words = diagnostics.stage + (diagnostics.message.empty() ? "" : "\n" + diagnostics.message);
  display_.setEstimate(estimate, words, pipeline_.fuser().boardPose());
  publishDiagnostics();
}

void FusionSession::publishDiagnostics() {
  DiagnosticsPublisher::Values values;
  values["worst latency [s]"] = worker_.takeWorstLatency();
  CalibratorDiagnostics diagnostics = pipeline_.diagnostics();
  for (const auto& [lane, name] :
       {std::pair<Lane, const char*>{kImu, "imu"}, {kVisual, "visual keyframes"}, {kLidar, "lidar keyframes"}}) {
    values[std::string(name) + " waiting"] = static_cast<double>(worker_.waiting(lane));
    diagnostics.counts[std::string(name) + " dropped in queue"] = worker_.dropped(lane);
  }
  diagnostics_.update(std::move(diagnostics), std::move(values));
}

}  // namespace cocalib
