#pragma once

#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <visualization_msgs/MarkerArray.h>

#include <cstddef>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "cocalib/monitor/progress.h"
#include "cocalib/ros/convergence_log.h"
#include "cocalib/ros/estimate_conversions.h"
#include "cocalib/ros/result_files.h"
#include "cocalib/ros/scene_collector.h"
#include "cocalib/ros/worker.h"

namespace cocalib {

/// What people watch while a calibration runs: `overlay`, `convergence` and `markers`. Draws on a thread of its own,
/// and only what somebody listens to. Also keeps what the pictures of the result need. All functions may be called from
/// any thread.
class LiveDisplay {
 public:
  LiveDisplay(ros::NodeHandle nh, const RigConfig& rig, const FrameNames& frames);
  ~LiveDisplay();

  /// @param camera  nothing for a rig without
  void setCamera(const std::optional<CameraModel>& camera);
  void addImu(const sensor_msgs::Imu& msg);
  void addImage(const sensor_msgs::ImageConstPtr& msg);
  void addImage(const sensor_msgs::CompressedImageConstPtr& msg);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& msg);
  void addState(const NavState& state);
  /// Where the board was found in a picture.
  void addBoard(TimeNs stamp, const BoardObservation& corners);
  void setEstimate(const CalibrationEstimate& estimate, const std::optional<Pose>& T_W_B);
  /// What stands above the rig, and which motion is asked for; publishes all markers. To be called about once a second.
  void setHint(const std::string& words, const std::optional<MotionHint>& hint);
  void reset();

  /// Everything the result files need, with this estimate.
  RunResult result(const CalibrationEstimate& estimate) const;

 private:
  enum Lane : std::size_t { kOverlay, kConvergence, kBoard };
  /// Who comes late, when there may be no more data, gets the newest of everything.
  void advertise(ros::NodeHandle nh);
  void drawNewestOverlay();
  void publishConvergence();
  void publishBoardViews();

  const RigConfig rig_;
  const FrameNames frames_;
  ros::Publisher overlay_publisher_, convergence_publisher_, marker_publisher_;
  mutable std::mutex mutex_;  // guards what follows, up to worker_
  std::optional<CameraModel> camera_;
  SceneCollector newest_, spread_;
  ConvergenceLog log_;
  CalibrationEstimate estimate_;
  std::optional<Pose> T_W_B_;
  std::map<TimeNs, BoardObservation> boards_;  // of the last seconds, by stamp on the camera's clock
  visualization_msgs::MarkerArray markers_;    // published last
  TimeNs last_drawn_ = 0, last_viewed_ = 0;
  Worker worker_;  // last: its jobs use all of the above
};

}  // namespace cocalib
