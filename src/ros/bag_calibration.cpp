#include "cocalib/ros/bag_calibration.h"

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "cocalib/ros/camera_pipeline.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/fuser_pipeline.h"
#include "cocalib/ros/input_inspection.h"
#include "cocalib/ros/lidar_pipeline.h"
#include "cocalib/ros/scene_collector.h"

namespace cocalib {
namespace {

constexpr double kSliceS = 2.0;        // of recording per round of work: long enough that a solve holds nobody up
constexpr double kSolvePeriodS = 2.0;  // of recording: unlike on a robot nobody waits for the next estimate
constexpr double kReadingPart = 0.8;   // of the whole run; the rest is the last solve
constexpr std::uint64_t kJudgeAfterClouds = 20;

/// Adds up how long the stages take. Thread-safe.
class StageClock {
 public:
  template <typename Work>
  void time(const std::string& stage, Work&& work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    const double gone_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    const std::lock_guard<std::mutex> lock(mutex_);
    seconds_[stage] += gone_s;
  }
  std::map<std::string, double> seconds() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return seconds_;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, double> seconds_;
};

/// One message of the rig; exactly one pointer is set.
struct Message {
  sensor_msgs::ImuConstPtr imu;
  sensor_msgs::ImageConstPtr image;
  sensor_msgs::CompressedImageConstPtr compressed;
  sensor_msgs::PointCloud2ConstPtr cloud;
  sensor_msgs::CameraInfoConstPtr camera_info;
  TimeNs received = 0;
};

/// A stretch of the recording, and what the calibrators made of it.
struct Slice {
  std::vector<Message> messages;
  std::vector<VisualKeyframe> visual;
  std::vector<LidarKeyframe> lidar;
  CalibrationEstimate visual_estimate, lidar_estimate;
};

template <typename Params>
Params seldomSolved() {
  Params params;
  params.solve_period_s = kSolvePeriodS;
  return params;
}

template <typename Keyframe>
void append(std::vector<Keyframe> more, std::vector<Keyframe>* all) {
  std::move(more.begin(), more.end(), std::back_inserter(*all));
}

}  // namespace

struct BagCalibration::Impl {
  Impl(const RigConfig& r, BagInput* in, Listener l)
      : rig(r),
        input(*in),
        listener(std::move(l)),
        camera_model(in->cameraModel()),
        fuser(rig, camera_model, seldomSolved<FuserParams>()),
        scenes(rig, SceneCollector::Keep::kSpread),
        inspection(rig),
        next(input.view().begin()) {
    if (camera_model) camera.emplace(rig, *camera_model, seldomSolved<VisualInertialParams>());
    if (rig.lidar) lidar.emplace(rig, seldomSolved<LidarInertialParams>());
    inspection.setCamera(camera_model);
  }

  std::optional<Slice> readSlice();
  Message read(const rosbag::MessageInstance& message);
  void show(const Message& message);
  void runCamera(Slice* slice);
  void runLidar(Slice* slice);
  bool runFuser(Slice* slice);
  void flush(Slice* slice);
  void meet(const Slice& slice, bool solved);
  void checkInput(bool at_end);
  void sayNotices();
  double partRead() const;

  RigConfig rig;
  BagInput& input;
  Listener listener;
  std::optional<CameraModel> camera_model;
  std::optional<CameraPipeline> camera;
  std::optional<LidarPipeline> lidar;
  FuserPipeline fuser;
  SceneCollector scenes;
  InputInspection inspection;
  ConvergenceLog log;
  rosbag::View::iterator next;
  std::optional<ros::Time> slice_begin;
  std::uint64_t imu_messages = 0;
  StageClock clock;
};

BagCalibration::BagCalibration(const RigConfig& rig, BagInput* input, Listener listener)
    : impl_(std::make_unique<Impl>(rig, input, std::move(listener))) {}
BagCalibration::~BagCalibration() = default;

Message BagCalibration::Impl::read(const rosbag::MessageInstance& message) {
  Message out;
  out.received = toTimeNs(message.getTime());
  switch (input.streamOf(message)) {
    case BagInput::Stream::kImu:
      out.imu = message.instantiate<sensor_msgs::Imu>();
      ++imu_messages;
      break;
    case BagInput::Stream::kImage:
      out.image = message.instantiate<sensor_msgs::Image>();
      break;
    case BagInput::Stream::kCompressedImage:
      out.compressed = message.instantiate<sensor_msgs::CompressedImage>();
      break;
    case BagInput::Stream::kCloud:
      out.cloud = message.instantiate<sensor_msgs::PointCloud2>();
      break;
    case BagInput::Stream::kCameraInfo:
      out.camera_info = message.instantiate<sensor_msgs::CameraInfo>();
      break;
  }
  return out;
}

/// To those who only look.
void BagCalibration::Impl::show(const Message& message) {
  const TimeNs received = message.received;
  if (message.camera_info && !rig.camera->model) inspection.addCameraInfo(*message.camera_info);
  if (message.imu) {
    scenes.addImu(*message.imu);
    inspection.addImu(*message.imu, received);
  }
  if (message.cloud) {
    scenes.addCloud(message.cloud);
    inspection.addCloud(*message.cloud, received);
  }
  if (message.image) {
    if (rig.lidar) scenes.addImage(message.image);
    inspection.addImage(*message.image, received);
  }
  if (message.compressed) {
    if (rig.lidar) scenes.addImage(message.compressed);
    inspection.addImage(*message.compressed, received);
  }
}

std::optional<Slice> BagCalibration::Impl::readSlice() {
  if (next == input.view().end()) return std::nullopt;
  Slice slice;
  slice_begin = next->getTime();
  const ros::Time end = *slice_begin + ros::Duration(kSliceS);
  for (; next != input.view().end() && next->getTime() < end; ++next) {
    Message message = read(*next);
    show(message);
    slice.messages.push_back(std::move(message));
  }
  return slice;
}

void BagCalibration::Impl::runCamera(Slice* slice) {
  if (!camera) return;
  for (const Message& message : slice->messages) {
    if (message.imu) camera->addImu(*message.imu);
    if (message.image) append(camera->addImage(*message.image), &slice->visual);
    if (message.compressed) append(camera->addImage(*message.compressed), &slice->visual);
  }
  slice->visual_estimate = camera->calibrator().estimate();
}

void BagCalibration::Impl::runLidar(Slice* slice) {
  if (!lidar) return;
  for (const Message& message : slice->messages) {
    if (message.imu) lidar->addImu(*message.imu);
    if (message.cloud) append(lidar->addCloud(*message.cloud), &slice->lidar);
  }
  slice->lidar_estimate = lidar->calibrator().estimate();
}

/// Keyframes go in by stamp, the camera's first where both are equal. Returns whether the estimate changed.
bool BagCalibration::Impl::runFuser(Slice* slice) {
  for (const Message& message : slice->messages) {
    if (message.imu && fuser.addImu(*message.imu)) log.clear();
  }
  if (camera) fuser.fuser().setVisualEstimate(slice->visual_estimate);
  if (lidar) fuser.fuser().setLidarEstimate(slice->lidar_estimate);
  bool changed = false;
  std::size_t v = 0, l = 0;
  while (v < slice->visual.size() || l < slice->lidar.size()) {
    const bool take_visual =
        l == slice->lidar.size() || (v < slice->visual.size() && slice->visual[v].stamp <= slice->lidar[l].scan.stamp);
    if (take_visual)
      fuser.addVisual(std::move(slice->visual[v++]));
    else
      fuser.addLidar(std::move(slice->lidar[l++]));
    if (!fuser.fuser().wantsSolve() || !fuser.fuser().solve()) continue;
    changed = true;
    log.add(fuser.fuser().estimate());
  }
  return changed;
}

void BagCalibration::Impl::flush(Slice* slice) {
  std::future<void> camera_work = std::async(std::launch::async, [&] {
    if (!camera) return;
    append(camera->calibrator().flush(), &slice->visual);
    slice->visual_estimate = camera->calibrator().estimate();
  });
  if (lidar) {
    append(lidar->calibrator().flush(), &slice->lidar);
    slice->lidar_estimate = lidar->calibrator().estimate();
  }
  camera_work.get();
}

/// What the parts tell each other between two slices.
void BagCalibration::Impl::meet(const Slice& slice, bool solved) {
  for (const LidarKeyframe& keyframe : slice.lidar) {
    if (keyframe.state) scenes.addState(*keyframe.state);
  }
  for (const VisualKeyframe& keyframe : slice.visual) inspection.addKeyframe(keyframe);
  if (solved) {
    const CalibrationEstimate estimate = fuser.fuser().estimate();
    if (camera && estimate.camera.valid) camera->calibrator().setJointCalibration(estimate.calibration);
    if (lidar && estimate.lidar.valid) lidar->calibrator().setJointCalibration(estimate.calibration);
  }
  sayNotices();
  checkInput(false);
}

void BagCalibration::Impl::checkInput(bool at_end) {
  if (camera && camera->rigProblem()) throw std::runtime_error(*camera->rigProblem());
  const auto fail = [this](const std::string& topic) {
    throw std::runtime_error(input.bag().getFileName() + ": no message on " + topic +
                             " in this part of the bag; read another part or take the sensor out of " + rig.file);
  };
  if (lidar && (at_end || lidar->notices().counted("clouds") >= kJudgeAfterClouds)) {
    if (const std::optional<std::string> problem = lidar->inputProblem()) {
      throw std::runtime_error(input.bag().getFileName() + ": " + *problem +
                               "; check the driver, or lidar: min_range, " + "max_range and point_time in " + rig.file);
    }
  }
  if (!at_end) return;
  if (imu_messages == 0) fail(rig.imu.topic);
  if (camera && camera->notices().counted("images") == 0) fail(rig.camera->topic);
  if (lidar && lidar->notices().counted("clouds") == 0) fail(rig.lidar->topic);
}

void BagCalibration::Impl::sayNotices() {
  if (!listener.notice) return;
  for (const Finding& finding : inspection.doctor().takeNew()) listener.notice(finding.words());
  if (camera) {
    for (const Notice& notice : camera->notices().take()) listener.notice(notice.text);
  }
  if (lidar) {
    for (const Notice& notice : lidar->notices().take()) listener.notice(notice.text);
  }
}

double BagCalibration::Impl::partRead() const {
  const double length_s = (input.end() - input.begin()).toSec();
  return length_s > 0.0 && slice_begin ? (*slice_begin - input.begin()).toSec() / length_s : 0.0;
}

std::map<std::string, double> BagCalibration::stageSeconds() const { return impl_->clock.seconds(); }

RunResult BagCalibration::run() {
  Impl& m = *impl_;
  const auto report = [&m](const std::string& stage, double part) {
    if (m.listener.progress) m.listener.progress(stage, part);
  };
  // Three slices are in work at a time: one is read, one is in the calibrators, one in the fuser.
  std::optional<Slice> fresh = m.readSlice();
  std::optional<Slice> calibrated;
  Slice last;
  while (fresh || calibrated) {
    std::optional<Slice> working = std::move(fresh);
    std::vector<std::future<void>> work;
    if (working) {
      work.push_back(std::async(std::launch::async, [&] { m.clock.time("camera", [&] { m.runCamera(&*working); }); }));
      work.push_back(std::async(std::launch::async, [&] { m.clock.time("lidar", [&] { m.runLidar(&*working); }); }));
    }
    bool solved = false;
    if (calibrated)
      work.push_back(
          std::async(std::launch::async, [&] { m.clock.time("fuser", [&] { solved = m.runFuser(&*calibrated); }); }));
    m.clock.time("reading", [&] { fresh = m.readSlice(); });
    for (std::future<void>& task : work) task.get();
    if (working) m.meet(*working, solved);
    report(m.log.empty() ? "looking for the sensors" : "refining", kReadingPart * m.partRead());
    calibrated = std::move(working);
  }
  m.checkInput(true);
  report("last round", kReadingPart);
  m.clock.time("last round", [&] {
    m.flush(&last);
    m.runFuser(&last);
    m.meet(last, false);
    m.fuser.fuser().finish([&](double part) { report("last round", kReadingPart + (1.0 - kReadingPart) * part); });
  });
  report("done", 1.0);

  RunResult result;
  result.estimate = m.fuser.fuser().estimate();
  m.log.add(result.estimate);
  result.log = m.log;
  result.camera = m.camera_model;
  result.T_W_B = m.fuser.fuser().boardPose();
  if (m.camera && m.lidar) {
    result.scene = m.scenes.best(result.estimate.calibration, *m.camera_model, result.T_W_B);
    result.scenes = m.scenes.some(kReportScenes);
  }
  result.findings = m.inspection.doctor().findings();
  result.motion = m.inspection.motion();
  result.board = m.inspection.board();
  result.residuals = m.fuser.fuser().residuals();
  return result;
}

}  // namespace cocalib
