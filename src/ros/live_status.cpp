#include "cocalib/ros/live_status.h"

#include <ros/console.h>
#include <ros/time.h>

#include <utility>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/topic_types.h"

namespace cocalib {
namespace {

const ObservabilityThresholds kThresholds;

}  // namespace

LiveStatus::LiveStatus(const RigConfig& rig) : rig_(rig), inspection_(rig), forecast_(kThresholds) {}

TimeNs LiveStatus::now() { return toTimeNs(ros::Time::now()); }

void LiveStatus::setCamera(const std::optional<CameraModel>& camera) {
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.setCamera(camera);
}

void LiveStatus::addCameraInfo(const sensor_msgs::CameraInfo& msg) {
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.addCameraInfo(msg);
}

void LiveStatus::addImu(const sensor_msgs::Imu& msg) {
  const TimeNs received = now();
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.addImu(msg, received);
}

void LiveStatus::addCloud(const sensor_msgs::PointCloud2& msg) {
  const TimeNs received = now();
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.addCloud(msg, received);
}

void LiveStatus::addKeyframe(const VisualKeyframe& keyframe) {
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.addKeyframe(keyframe);
}

void LiveStatus::report(Finding finding) {
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.doctor().report(std::move(finding));
}

void LiveStatus::setEstimate(const CalibrationEstimate& estimate, const std::string& stage) {
  const std::lock_guard<std::mutex> lock(mutex_);
  estimate_ = estimate;
  stage_ = stage;
  forecast_.add(estimate);
}

void LiveStatus::restart() {
  const std::lock_guard<std::mutex> lock(mutex_);
  inspection_.restart();
  forecast_.clear();
  estimate_ = CalibrationEstimate();
}

bool LiveStatus::logFindings() {
  const TimeNs time = now();
  std::vector<Finding> fresh, wrong_types;
  if (awaitsSensor()) wrong_types = findWrongTypes(rig_);  // unlocked: the master may take its time
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (Finding& finding : wrong_types) inspection_.doctor().report(std::move(finding));
    if (time > 0) inspection_.doctor().tick(time);  // simulated time is 0 until it comes
    fresh = inspection_.doctor().takeNew();
  }
  for (const Finding& finding : fresh) {
    if (finding.weight == Finding::Weight::kError)
      ROS_ERROR("%s", finding.words().c_str());
    else
      ROS_WARN("%s", finding.words().c_str());
  }
  return !fresh.empty();
}

bool LiveStatus::awaitsSensor() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return inspection_.doctor().awaitsSensor();
}

std::string LiveStatus::words() const {
  const std::optional<MotionHint> motion = hint();
  const std::lock_guard<std::mutex> lock(mutex_);
  return progressWords(estimate_, stage_, kThresholds, forecast_.secondsLeft(), motion);
}

std::string LiveStatus::headline() const {
  const std::optional<MotionHint> motion = hint();
  const std::lock_guard<std::mutex> lock(mutex_);
  const std::string step = nextStep(estimate_, stage_, motion);
  return step.empty() ? stage_ : stage_ + ": " + step;
}

std::optional<MotionHint> LiveStatus::hint() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (inspection_.motion().duration_s() <= 0.0) return std::nullopt;
  return adviseMotion(estimate_, inspection_.motion().turned_rad(), kThresholds);
}

std::vector<std::string> LiveStatus::findings() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return inspection_.words();
}

void LiveStatus::fill(RunResult* result) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  result->findings = inspection_.doctor().findings();
  result->motion = inspection_.motion();
  result->board = inspection_.board();
}

}  // namespace cocalib
