#pragma once

#include <ros/node_handle.h>
#include <ros/service_server.h>
#include <ros/subscriber.h>
#include <ros/time.h>
#include <std_msgs/String.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "cocalib/monitor/pace.h"
#include "cocalib/ros/diagnostics_publisher.h"
#include "cocalib/ros/estimate_conversions.h"
#include "cocalib/ros/keyframe_conversions.h"
#include "cocalib/ros/messages.h"
#include "cocalib/ros/nodelet_support.h"
#include "cocalib/ros/worker.h"

namespace cocalib {

/// What the camera's and the lidar's nodelets have in common: a pipeline on a thread of its own, its keyframes, its
/// estimate, the feedback of the joint calibration, start and stop. On a machine that is too slow it uses fewer data
/// rather than older ones, and says so. `Pipeline` is CameraPipeline or LidarPipeline.
template <typename Pipeline, typename KeyframeMsg, SensorPart kPart>
class SensorSession {
 public:
  /// @param data_queue  messages of the sensor that may wait
  template <typename... PipelineArguments>
  SensorSession(ros::NodeHandle private_nh, const RigConfig& rig, std::size_t data_queue,
                const PipelineArguments&... arguments)
      : frames_(frameNamesOf(rig)),
        keyframe_publisher_(private_nh.advertise<KeyframeMsg>("keyframes", 200)),
        estimate_publisher_(private_nh.advertise<ExtrinsicEstimate>("estimate", 10, true)),
        diagnostics_(private_nh, private_nh, kPart == SensorPart::kCamera ? "cocalib camera" : "cocalib lidar"),
        pipeline_(rig, arguments...),
        worker_({20'000, data_queue, 100}) {}

  void addImu(const sensor_msgs::ImuConstPtr& msg) {
    worker_.post(kImu, [this, msg] {
      if (active_) pipeline_.addImu(*msg);
    });
  }

  /// @param process  Pipeline& -> keyframes; runs on the worker's thread
  template <typename Process>
  void addData(Process process) {
    const auto came = Clock::now();
    worker_.post(kData, [this, process, came] {
      if (!active_) return;
      const auto now = Clock::now();
      waited_s_ = Seconds(now - came).count();
      if (!pace_.take(Seconds(now.time_since_epoch()).count(), waited_s_)) {
        ++too_late_;
        return publish(decltype(process(pipeline_))());
      }
      pipeline_.calibrator().setEffort(pace_.share());
      publish(process(pipeline_));
    });
  }

  /// Runs act(Pipeline&) on the worker's thread, also while no data are taken.
  template <typename Act>
  void withPipeline(Act act) {
    worker_.post(kControl, [this, act] { act(pipeline_); });
  }

  void setJoint(const CalibrationEstimateConstPtr& msg) {
    if (!(kPart == SensorPart::kCamera ? msg->camera.valid : msg->lidar.valid)) return;
    const Calibration calibration = fromEstimateMsg(*msg).calibration;
    const ros::Time stamp = msg->header.stamp;
    worker_.post(kControl, [this, calibration, stamp] {
      if (stamp == last_joint_) return;  // only its words are new
      last_joint_ = stamp;
      pipeline_.calibrator().setJointCalibration(calibration);
    });
  }

  /// "start": begin anew, "stop": take no more data.
  void obey(const std_msgs::StringConstPtr& msg) {
    const bool start = msg->data == "start";
    worker_.post(kControl, [this, start] {
      active_ = start;
      if (!start) return;
      pipeline_.reset();
      last_estimate_ = 0;
    });
  }

  /// Hands on what is held back at the end of the data; returns when it is published.
  void flush() {
    worker_.post(kControl, [this] { publish(pipeline_.calibrator().flush()); });
    worker_.drain();
  }

  /// Works off nothing more; returns when the running job has ended.
  void stop() { worker_.stop(); }

 private:
  using Clock = std::chrono::steady_clock;
  using Seconds = std::chrono::duration<double>;
  enum Lane : std::size_t { kImu, kData, kControl };

  template <typename Keyframe>
  void publish(const std::vector<Keyframe>& keyframes) {
    const std::string& frame = kPart == SensorPart::kCamera ? frames_.camera : frames_.lidar;
    for (const Keyframe& keyframe : keyframes) {
      const auto msg = boost::make_shared<KeyframeMsg>(toKeyframeMsg(keyframe, frame));
      renumberTracks(msg.get());
      keyframe_publisher_.publish(msg);
    }
    logNotices(&pipeline_.notices());
    CalibratorDiagnostics diagnostics = pipeline_.diagnostics();
    if (pace_.tooSlow())
      diagnostics.findings.push_back(tooSlow(kPart == SensorPart::kCamera ? "camera" : "lidar").words());
    const CalibrationEstimate estimate = pipeline_.calibrator().estimate();
    const bool found_more = diagnostics.findings.size() != last_findings_;
    if (estimate.stamp != last_estimate_ || diagnostics.message != last_words_ || found_more) {
      last_estimate_ = estimate.stamp;
      last_findings_ = diagnostics.findings.size();
      last_words_ = diagnostics.message;
      estimate_publisher_.publish(
          boost::make_shared<ExtrinsicEstimate>(toExtrinsicMsg(estimate, kPart, diagnostics, frames_)));
    }
    diagnostics.counts["imu samples dropped in queue"] = worker_.dropped(kImu);
    diagnostics.counts["data dropped in queue"] = worker_.dropped(kData);
    diagnostics.counts["data dropped as too late"] = too_late_;
    diagnostics_.update(std::move(diagnostics), {{"data waiting", static_cast<double>(worker_.waiting(kData))},
                                                 {"wait of the data [s]", waited_s_},
                                                 {"data left out [%]", 100.0 * (1.0 - pace_.share())},
                                                 {"worst latency [s]", worker_.takeWorstLatency()}});
  }

  /// A nodelet that is loaded again counts its tracks from 0 again, but the fuser knows those numbers from before. No
  /// tracker begins a thousand tracks a second, so milliseconds keep them apart.
  void renumberTracks(VisualKeyframeMsg* msg) const {
    for (std::uint32_t& id : msg->track_ids) id += first_track_;
  }
  static void renumberTracks(LidarKeyframeMsg*) {}

  const FrameNames frames_;
  const std::uint32_t first_track_ = static_cast<std::uint32_t>(ros::WallTime::now().toNSec() / 1'000'000);
  ros::Publisher keyframe_publisher_, estimate_publisher_;
  DiagnosticsPublisher diagnostics_;
  // Used by worker_ only.
  Pipeline pipeline_;
  bool active_ = true;
  TimeNs last_estimate_ = 0;
  ros::Time last_joint_;
  std::string last_words_;
  std::size_t last_findings_ = 0;
  Pace pace_;
  std::uint64_t too_late_ = 0;
  double waited_s_ = 0.0;  // what came up last
  Worker worker_;          // last: its jobs use all of the above
};

}  // namespace cocalib
