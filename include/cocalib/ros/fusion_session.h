#pragma once

#include <ros/node_handle.h>

#include <atomic>
#include <memory>
#include <optional>
#include <string>

#include "cocalib/ros/diagnostics_publisher.h"
#include "cocalib/ros/estimate_publisher.h"
#include "cocalib/ros/fuser_pipeline.h"
#include "cocalib/ros/live_display.h"
#include "cocalib/ros/messages.h"
#include "cocalib/ros/worker.h"

namespace cocalib {

/// One live co-calibration: the fuser on its own thread, what it publishes, and its result on disk. All functions may
/// be called from any thread; none of them solves on the caller's, but finish() and save() wait for what they ask for.
class FusionSession {
 public:
  /// @param output  directory of the result files
  /// @throws std::runtime_error if the directory cannot be used
  FusionSession(ros::NodeHandle nh, ros::NodeHandle private_nh, const RigConfig& rig, const std::string& output,
                const std::optional<CameraModel>& camera);
  /// Ends the running solve and writes the result if it has not been written.
  ~FusionSession();

  void addImu(const sensor_msgs::ImuConstPtr& msg);
  void addVisual(const VisualKeyframeConstPtr& msg);
  void addLidar(const LidarKeyframeConstPtr& msg);
  void setVisualEstimate(const ExtrinsicEstimateConstPtr& msg);
  void setLidarEstimate(const ExtrinsicEstimateConstPtr& msg);
  /// Pictures and sweeps are only shown here, and stamp tf.
  void addImage(const sensor_msgs::ImageConstPtr& msg);
  void addCompressed(const sensor_msgs::CompressedImageConstPtr& msg);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& msg);

  /// Begins anew and takes data.
  void restart();
  /// Takes no more data and does the last round over all of it; returns when it is done.
  void finish();
  /// Writes the result files. @return whether it worked; `words` say where to, or why not
  bool save(std::string* words);

 private:
  enum Lane : std::size_t { kImu, kVisual, kLidar, kControl };
  void solveIfDue();
  void publish();
  void publishDiagnostics();

  const RigConfig rig_;
  const FrameNames frames_;
  const std::string output_;
  std::atomic<bool> active_{true};  // takes data
  std::atomic<bool> unsaved_{false};
  EstimatePublisher publisher_;
  DiagnosticsPublisher diagnostics_;
  LiveDisplay display_;
  FuserPipeline pipeline_;  // used by worker_ only
  bool greeted_ = false;    // used by worker_ only
  Worker worker_;           // last: its jobs use all of the above
};

}  // namespace cocalib
