#include "cocalib/ros/lidar_pipeline.h"

#include <stdexcept>
#include <utility>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

const RigConfig::Lidar& lidarOf(const RigConfig& rig) {
  if (!rig.lidar) throw std::invalid_argument(rig.file + ": the rig has no lidar");
  return *rig.lidar;
}

LidarInertialParams withRangeNoise(LidarInertialParams params, double range_noise_m) {
  params.range_noise_m = range_noise_m;
  return params;
}

}  // namespace

LidarPipeline::LidarPipeline(const RigConfig& rig, LidarInertialParams params)
    : topic_(lidarOf(rig).topic),
      reader_(*rig.lidar),
      calibrator_(withRangeNoise(params, rig.lidar->range_noise_m), rig.imu.noise, rig.guess_T_imu_lidar) {}

void LidarPipeline::addImu(const sensor_msgs::Imu& msg) {
  const ImuStream::Outcome outcome = imu_.take(msg, &notices_);
  if (outcome.restart) calibrator_.reset();
  if (outcome.sample) calibrator_.addImu(*outcome.sample);
}

void LidarPipeline::reset() {
  imu_.reset();
  calibrator_.reset();
}

std::vector<LidarKeyframe> LidarPipeline::addCloud(const sensor_msgs::PointCloud2& msg,
                                                   const std::function<void()>& look) {
  notices_.count("clouds");
  if (!imu_.accepts(toTimeNs(msg.header.stamp), topic_, "clouds", &notices_)) return {};
  std::string problem;
  std::optional<LidarScan> scan = reader_.read(msg, &problem);
  if (!scan || scan->points.empty()) {
    notices_.count("clouds refused");
    last_problem_ = scan ? "no usable point" : problem;
    notices_.warn(topic_ + ": " + last_problem_);
    return {};
  }
  if (!reader_.description().empty()) notices_.inform(topic_ + ": " + reader_.description());
  if (!reader_.warning().empty()) notices_.warn(topic_ + ": " + reader_.warning());
  return calibrator_.addScan(std::move(*scan), look);
}

std::optional<std::string> LidarPipeline::inputProblem() const {
  const std::uint64_t clouds = notices_.counted("clouds");
  if (clouds == 0 || notices_.counted("clouds refused") < clouds) return std::nullopt;
  return topic_ + ": none of " + std::to_string(clouds) + " clouds can be used: " + last_problem_;
}

CalibratorDiagnostics LidarPipeline::diagnostics() const {
  CalibratorDiagnostics diagnostics = notices_.addTo(calibrator_.diagnostics());
  if (const std::optional<std::string> problem = inputProblem()) diagnostics.findings.push_back(*problem);
  diagnostics.counts["points dropped"] = reader_.droppedPoints();
  return diagnostics;
}

}  // namespace cocalib
