#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/camera_info.h"
#include "cocalib/ros/camera_pipeline.h"
#include "cocalib/ros/estimate_conversions.h"
#include "cocalib/ros/fuser_pipeline.h"
#include "cocalib/ros/input_inspection.h"
#include "cocalib/ros/lidar_pipeline.h"
#include "cocalib/ros/nodelet_support.h"
#include "recording.h"

namespace cocalib::test {

/// What became of a calibration, and what the user read of it.
struct Outcome {
  struct Sensor {
    SensorVerdict verdict;
    Vector6d error = Vector6d::Zero();
    double offset_error_s = 0.0;
  };
  CalibrationEstimate estimate;
  std::vector<Sensor> sensors;  ///< of the recording: the camera first
  std::set<std::string> lines;  ///< on the console, in estimate and in diagnostics
  bool finite = true;           ///< every number that was published
  std::vector<std::pair<double, TimeNs>>
      refreshes;  ///< when received [s] the joint estimate changed, and its new stamp

  bool said(const std::string& part) const {
    return std::any_of(lines.begin(), lines.end(),
                       [&](const std::string& line) { return line.find(part) != std::string::npos; });
  }
  /// Time from `since` until a joint estimate came that uses newer data [s]; infinite if none did.
  double recovery_s(double since, TimeNs epoch) const {
    for (const auto& [received_s, stamp] : refreshes) {
      if (received_s >= since && stamp >= epoch + toNs(since)) return received_s - since;
    }
    return std::numeric_limits<double>::infinity();
  }
};

/// Calibrators of the recording's sensors, fuser and input doctor, with the pipelines of nodelets and bag runner, on
/// one thread. A picture of which only is known what is seen in it passes by the reader of pictures.
class FaultRun {
 public:
  /// @param square_m  side of a square of the board, as the rig file says
  explicit FaultRun(const Recording& recording, double square_m = 0.10)
      : recording_(recording), rig_(parseRig(rigFile(recording, square_m), "rig.yaml")), inspection_(rig_) {
    if (rig_.lidar) lidar_.emplace(rig_);
    if (!rig_.camera) fuser_.emplace(rig_, std::nullopt);
  }

  Outcome run() {
    for (const Recording::Event& e : recording_.events) {
      now_s_ = e.received_s;
      const TimeNs received = recording_.scenario.epoch + toNs(e.received_s);
      inspection_.doctor().tick(received);
      switch (e.kind) {
        case Recording::Kind::kImu:
          addImu(e.imu, received);
          break;
        case Recording::Kind::kCloud:
          inspection_.addCloud(e.cloud, received);
          hand(lidar_->addCloud(e.cloud));
          break;
        case Recording::Kind::kPicture:
          addPicture(e.picture, received);
          break;
        case Recording::Kind::kInfo:
          addInfo(e.info);
          break;
      }
    }
    finish();
    return outcome_;
  }

 private:
  static std::string rigFile(const Recording& recording, double square_m) {
    const sim::Scenario& s = recording.scenario;
    std::string text = R"(
imu: {topic: /imu/data, gyroscope_noise_density: 1.745e-4, gyroscope_random_walk: 1.0e-6,
      accelerometer_noise_density: 5.884e-4, accelerometer_random_walk: 1.0e-5})";
    if (s.camera.present) text += "\ncamera: {topic: /camera/image_raw, info_topic: /camera/camera_info}";
    if (s.camera.present && s.board.present) {
      text += "\ntarget: {type: checkerboard, cols: 8, rows: 6, square: " + std::to_string(square_m) + "}";
    }
    if (recording.has_lidar) text += "\nlidar: {topic: /velodyne_points, range_noise: 0.03}";
    return text;
  }

  void addImu(const sensor_msgs::Imu& msg, TimeNs received) {
    inspection_.addImu(msg, received);
    if (lidar_) lidar_->addImu(msg);
    if (camera_) camera_->addImu(msg);
    if (fuser_) fuser_->addImu(msg);
  }
  /// The first one that can be used counts.
  void addInfo(const sensor_msgs::CameraInfo& msg) {
    inspection_.addCameraInfo(msg);
    if (camera_) return;
    std::string problem;
    const std::optional<CameraModel> model = readCameraInfo(msg, &problem);
    if (!model) {
      outcome_.lines.insert(problem);
      return;
    }
    inspection_.setCamera(model);
    camera_.emplace(rig_, *model);
    fuser_.emplace(rig_, model);
  }
  void addPicture(const Picture& picture, TimeNs received) {
    if (picture.compressed) {
      inspection_.addImage(*picture.compressed, received);
      if (camera_) hand(camera_->addImage(*picture.compressed));
    } else if (picture.raw) {
      inspection_.addImage(*picture.raw, received);
      if (camera_) hand(camera_->addImage(*picture.raw));
    } else {
      inspection_.doctor().addImage(picture.seen.stamp, received);
      if (camera_) hand(camera_->calibrator().addMeasurements(picture.seen));
    }
  }

  void hand(std::vector<LidarKeyframe> keyframes) {
    if (!fuser_) return;
    for (LidarKeyframe& keyframe : keyframes) fuser_->addLidar(std::move(keyframe));
    fuser_->fuser().setLidarEstimate(lidar_->calibrator().estimate());
    solve();
  }
  void hand(std::vector<VisualKeyframe> keyframes) {
    for (VisualKeyframe& keyframe : keyframes) fuser_->addVisual(std::move(keyframe));
    fuser_->fuser().setVisualEstimate(camera_->calibrator().estimate());
    solve();
  }
  void solve() {
    while (fuser_->fuser().wantsSolve() && fuser_->fuser().solve()) {
      const CalibrationEstimate estimate = fuser_->fuser().estimate();
      outcome_.refreshes.emplace_back(now_s_, estimate.stamp);
      if (lidar_ && estimate.lidar.valid) lidar_->calibrator().setJointCalibration(estimate.calibration);
      if (camera_ && estimate.camera.valid) camera_->calibrator().setJointCalibration(estimate.calibration);
      look();
    }
    look();
  }

  void finish() {
    for (const std::string& words : inspection_.words()) outcome_.lines.insert(words);
    if (!fuser_) return;
    if (lidar_) hand(lidar_->calibrator().flush());
    if (camera_) hand(camera_->calibrator().flush());
    fuser_->fuser().finish();
    look();
    outcome_.estimate = fuser_->fuser().estimate();
    const Calibration& c = outcome_.estimate.calibration;
    const sim::Scenario& s = recording_.scenario;
    if (camera_) {
      outcome_.sensors.push_back({outcome_.estimate.camera, c.T_imu_camera.minus(s.camera.T_imu_camera()),
                                  c.camera_time_offset_s - s.camera.time_offset_s});
    }
    if (lidar_) {
      outcome_.sensors.push_back({outcome_.estimate.lidar, c.T_imu_lidar.minus(s.lidar.T_imu_lidar()),
                                  c.lidar_time_offset_s - s.lidar.time_offset_s});
    }
  }

  /// What is published after each step.
  void look() {
    if (lidar_) note(&lidar_->notices(), lidar_->diagnostics());
    if (camera_) note(&camera_->notices(), camera_->diagnostics());
    note(nullptr, fuser_->diagnostics());
    const CalibrationEstimate estimate = fuser_->fuser().estimate();
    const CalibrationEstimateMsg msg = toEstimateMsg(estimate, fuser_->diagnostics(), frameNamesOf(rig_));
    for (const ExtrinsicEstimate& part : {msg.lidar, msg.camera}) {
      const Pose pose = fromPoseMsg(part.pose.pose);
      outcome_.finite = outcome_.finite && pose.t.allFinite() && pose.q.coeffs().allFinite() &&
                        std::isfinite(part.time_offset) && allFinite(part.pose.covariance);
    }
    outcome_.finite = outcome_.finite && allFinite(msg.joint_covariance);
  }
  void note(Notices* notices, const CalibratorDiagnostics& diagnostics) {
    if (notices != nullptr) {
      for (const Notice& notice : notices->take()) outcome_.lines.insert(notice.text);
    }
    outcome_.lines.insert(diagnostics.message);
    for (const auto& [what, number] : diagnostics.counts) {
      if (number > 0) outcome_.lines.insert(what);
    }
  }
  template <typename Numbers>
  static bool allFinite(const Numbers& numbers) {
    return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
  }

  const Recording& recording_;
  RigConfig rig_;
  InputInspection inspection_;
  std::optional<LidarPipeline> lidar_;
  std::optional<CameraPipeline> camera_;
  std::optional<FuserPipeline> fuser_;
  double now_s_ = 0.0;
  Outcome outcome_;
};

}  // namespace cocalib::test
