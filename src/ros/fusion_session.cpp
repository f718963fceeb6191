#include "cocalib/ros/fusion_session.h"

#include <ros/console.h>

#include <chrono>
#include <exception>
#include <utility>

#include "cocalib/measurements/thinning.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/imu_reader.h"
#include "cocalib/ros/keyframe_conversions.h"
#include "cocalib/ros/nodelet_support.h"
#include "cocalib/ros/result_files.h"

namespace cocalib {
namespace {

// What may wait while a solve of some seconds runs.
constexpr std::size_t kImuQueue = 20'000, kVisualQueue = 1'000, kLidarQueue = 300, kControlQueue = 100;
constexpr double kStatusPeriodS = 1.0;

}  // namespace

FusionSession::FusionSession(ros::NodeHandle nh, ros::NodeHandle private_nh, const RigConfig& rig,
                             const std::string& output, const std::optional<CameraModel>& camera)
    : rig_(rig),
      frames_(frameNamesOf(rig)),
      output_(output),
      publisher_(nh, frames_),
      diagnostics_(nh, private_nh, "cocalib fuser"),
      display_(nh, rig, frames_),
      status_(rig),
      rivals_(nh, frames_,
              [this](const std::string& frame, const std::string& words) {
                publisher_.yield(frame);
                status_.report({"tf " + frame + " " + words, words, ""});
              }),
      pipeline_(rig, camera),
      worker_({kImuQueue, kVisualQueue, kLidarQueue, kControlQueue}) {
  prepareOutputDirectory(output_);
  display_.setCamera(camera);
  status_.setCamera(camera);
  worker_.post(kControl, [this] { publish(); });
  timer_ = nh.createWallTimer(ros::WallDuration(kStatusPeriodS), [this](const ros::WallTimerEvent&) { tellStatus(); });
}

FusionSession::~FusionSession() {
  timer_.stop();
  worker_.stop();
  std::string words;
  if (unsaved_ && !save(&words)) ROS_ERROR("%s", words.c_str());
}

void FusionSession::addImu(const sensor_msgs::ImuConstPtr& msg) {
  if (!active_) return;
  display_.addImu(*msg);
  status_.addImu(*msg);
  if (const std::optional<ImuSample> sample = readImu(*msg, nullptr)) publisher_.broadcastStart(*sample);
  worker_.post(kImu, [this, msg] {
    if (!greeted_) unsaved_ = greeted_ = true;
    if (!pipeline_.addImu(*msg)) return;
    ROS_WARN("the clock was set back: starting over");
    publisher_.reset();
    display_.reset();
    status_.restart();
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
    status_.addKeyframe(keyframe);
    if (keyframe.board) display_.addBoard(keyframe.stamp, *keyframe.board);
    if (!isKept(pictures_++, pace_.share())) return solveIfDue();
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
    thin(&keyframe.scan, pace_.share());
    pipeline_.addLidar(std::move(keyframe));
    solveIfDue();
  });
}

void FusionSession::setVisualEstimate(const ExtrinsicEstimateConstPtr& msg) {
  for (const std::string& finding : msg->findings) status_.report({finding, finding, ""});
  worker_.post(kControl, [this, msg] {
    const bool changed = pipeline_.fuser().setVisualEstimate(fromExtrinsicMsg(*msg, SensorPart::kCamera));
    changed ? publish() : publishDiagnostics();
  });
}

void FusionSession::setLidarEstimate(const ExtrinsicEstimateConstPtr& msg) {
  for (const std::string& finding : msg->findings) status_.report({finding, finding, ""});
  worker_.post(kControl, [this, msg] {
    const bool changed = pipeline_.fuser().setLidarEstimate(fromExtrinsicMsg(*msg, SensorPart::kLidar));
    changed ? publish() : publishDiagnostics();
  });
}

void FusionSession::addImage(const sensor_msgs::ImageConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (!active_) return;
  status_.addImage(*msg);
  if (rig_.lidar) display_.addImage(msg);
}

void FusionSession::addCompressed(const sensor_msgs::CompressedImageConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (!active_) return;
  status_.addImage(*msg);
  if (rig_.lidar) display_.addImage(msg);
}

void FusionSession::addCloud(const sensor_msgs::PointCloud2ConstPtr& msg) {
  publisher_.broadcastMountings(toTimeNs(msg->header.stamp));
  if (!active_) return;
  status_.addCloud(*msg);
  display_.addCloud(msg);
}

void FusionSession::restart() {
  worker_.post(kControl, [this] {
    pipeline_.reset();
    publisher_.reset();
    display_.reset();
    status_.restart();
    greeted_ = false;
    publish();
  });
  worker_.drain();
  active_ = true;
}

void FusionSession::finish() {
  active_ = false;
  worker_.post(kControl, [this] {
    if (!pipeline_.frozen()) pipeline_.fuser().finish();
    unsaved_ = true;
    publish();
  });
  worker_.drain();
}

bool FusionSession::freeze(std::string* words) {
  bool done = false;
  worker_.post(kControl, [&] { done = freezeNow(); });
  worker_.drain();
  *words = done ? "frozen: the mountings are static transforms now, and watched; resume calibrates anew"
                : "nothing is known yet that could be frozen";
  return done;
}

bool FusionSession::freezeNow() {
  const CalibrationEstimate estimate = pipeline_.fuser().estimate();
  if (!estimate.camera.valid && !estimate.lidar.valid) return false;
  pipeline_.freeze();
  publisher_.freeze(estimate);
  publish();
  return true;
}

void FusionSession::configure(const SessionSettings& settings) {
  freeze_when_converged_ = settings.freeze_when_converged;
  publisher_.setTfEnabled(settings.publish_tf);
  timer_.setPeriod(ros::WallDuration(settings.status_period_s));
}

bool FusionSession::save(std::string* words) {
  // From the worker's thread; after stop() there is no such thread, and none is needed.
  CalibrationEstimate estimate;
  ResidualSamples residuals;
  bool fetched = false;
  const auto fetch = [&] {
    estimate = pipeline_.fuser().estimate();
    residuals = pipeline_.fuser().residuals();
    fetched = true;
  };
  worker_.post(kControl, fetch);
  worker_.drain();
  if (!fetched) fetch();
  try {
    RunResult result = display_.result(estimate);
    result.residuals = std::move(residuals);
    status_.fill(&result);
    writeResultFiles(output_, rig_, result);
  } catch (const std::exception& error) {
    *words = error.what();
    return false;
  }
  unsaved_ = false;
  *words = output_ + "/calibration.yaml";
  ROS_INFO("%swritten: %s", describeResult(rig_, estimate).c_str(), words->c_str());
  return true;
}

/// Not before everything that waits has been taken in: one solve for all of it, where solves take long.
void FusionSession::solveIfDue() {
  if (worker_.waiting(kVisual) + worker_.waiting(kLidar) > 0) return;
  if (pipeline_.frozen()) return lookAtMountings();
  if (pipeline_.fuser().wantsSolve()) solve();
}

void FusionSession::solve() {
  using Clock = std::chrono::steady_clock;
  using Seconds = std::chrono::duration<double>;
  const auto begin = Clock::now();
  const bool changed = pipeline_.fuser().solve();
  const auto end = Clock::now();
  pace_.take(Seconds(end.time_since_epoch()).count(), Seconds(end - begin).count());
  if (pace_.tooSlow()) status_.report(tooSlow("fuser"));
  if (!changed) return;
  unsaved_ = true;
  publish();
  if (freeze_when_converged_ && pipeline_.fuser().estimate().status == Status::kConverged) freezeNow();
}

void FusionSession::lookAtMountings() {
  for (const MountingChange& change : pipeline_.watch()) {
    status_.report({change.sensor + " mounting", change.words, "fasten it, then call resume to calibrate anew",
                    Finding::Weight::kError});
  }
}

void FusionSession::publish() {
  const CalibrationEstimate estimate = pipeline_.fuser().estimate();
  const CalibratorDiagnostics diagnostics = pipeline_.diagnostics();
  status_.setEstimate(estimate, diagnostics.stage);
  display_.setEstimate(estimate, pipeline_.fuser().boardPose());
  {
    const std::lock_guard<std::mutex> lock(newest_mutex_);
    newest_ = {estimate, diagnostics};
  }
  publishEstimate();
  publishDiagnostics();
}

/// The newest estimate with the words and findings of this moment.
void FusionSession::publishEstimate() {
  std::pair<CalibrationEstimate, CalibratorDiagnostics> newest;
  {
    const std::lock_guard<std::mutex> lock(newest_mutex_);
    newest = newest_;
  }
  newest.second.progress = status_.words();
  newest.second.findings = status_.findings();
  publisher_.publish(newest.first, newest.second);
  display_.setHint(status_.headline(), status_.hint());
}

void FusionSession::tellStatus() {
  if (!active_) return;
  status_.logFindings();
  ROS_INFO("%s", status_.words().c_str());
  publishEstimate();
}

void FusionSession::publishDiagnostics() {
  DiagnosticsPublisher::Values values;
  values["worst latency [s]"] = worker_.takeWorstLatency();
  values["data left out [%]"] = 100.0 * (1.0 - pace_.share());
  CalibratorDiagnostics diagnostics = pipeline_.diagnostics();
  diagnostics.findings = status_.findings();
  for (const auto& [lane, name] :
       {std::pair<Lane, const char*>{kImu, "imu"}, {kVisual, "visual keyframes"}, {kLidar, "lidar keyframes"}}) {
    values[std::string(name) + " waiting"] = static_cast<double>(worker_.waiting(lane));
    diagnostics.counts[std::string(name) + " dropped in queue"] = worker_.dropped(lane);
  }
  diagnostics_.update(std::move(diagnostics), values);
}

}  // namespace cocalib
