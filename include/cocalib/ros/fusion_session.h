#pragma once

#include <ros/node_handle.h>
#include <ros/wall_timer.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "cocalib/monitor/pace.h"
#include "cocalib/ros/diagnostics_publisher.h"
#include "cocalib/ros/estimate_publisher.h"
#include "cocalib/ros/fuser_pipeline.h"
#include "cocalib/ros/live_display.h"
#include "cocalib/ros/live_status.h"
#include "cocalib/ros/messages.h"
#include "cocalib/ros/tf_rivals.h"
#include "cocalib/ros/worker.h"

namespace cocalib {

/// What may change while a calibration runs.
struct SessionSettings {
  bool publish_tf = true;
  bool freeze_when_converged = false;
  double status_period_s = 1.0;  ///< between two lines on the console
};

/// One live co-calibration: the fuser on its own thread, what it publishes, and its result on disk. Where solving takes
/// too long it uses fewer data, and says so. All functions may be called from any thread; none of them solves on the
/// caller's, but finish() and save() wait for what they ask for.
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
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& msg) { status_.addCameraInfo(*msg); }
  /// Pictures and sweeps are only shown here, and stamp tf.
  void addImage(const sensor_msgs::ImageConstPtr& msg);
  void addCompressed(const sensor_msgs::CompressedImageConstPtr& msg);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& msg);

  /// Begins anew and takes data.
  void restart();
  /// Takes no more data and does the last round over all of it; returns when it is done.
  void finish();
  /// Returns when everything handed over before has been worked in.
  void flush() { worker_.drain(); }
  /// Holds the estimate: static transforms, and a watch over the mountings until restart(). @return whether there was
  /// one
  bool freeze(std::string* words);
  void configure(const SessionSettings& settings);
  /// Writes the result files. @return whether it worked; `words` say where to, or why not
  bool save(std::string* words);

 private:
  enum Lane : std::size_t { kImu, kVisual, kLidar, kControl };
  static constexpr double kLongSolve_s = 0.45;  // new data wait for one solve, and then for their own
  void solveIfDue();
  void solve();
  bool freezeNow();
  void lookAtMountings();
  void publish();
  void publishDiagnostics();
  void publishEstimate();
  void tellStatus();

  const RigConfig rig_;
  const FrameNames frames_;
  const std::string output_;
  std::atomic<bool> active_{true};  // takes data
  std::atomic<bool> unsaved_{false};
  std::atomic<bool> freeze_when_converged_{false};
  EstimatePublisher publisher_;
  DiagnosticsPublisher diagnostics_;
  LiveDisplay display_;
  LiveStatus status_;
  TfRivals rivals_;
  FuserPipeline pipeline_;    // used by worker_ only
  bool greeted_ = false;      // used by worker_ only
  Pace pace_{kLongSolve_s};   // used by worker_ only
  std::size_t pictures_ = 0;  // used by worker_ only
  std::mutex newest_mutex_;   // guards newest_
  std::pair<CalibrationEstimate, CalibratorDiagnostics> newest_;
  Worker worker_;         // its jobs use all of the above
  ros::WallTimer timer_;  // last: it posts jobs
};

}  // namespace cocalib
