#include "cocalib/ros/fuser_pipeline.h"

#include <utility>

#include "cocalib/ros/imu_reader.h"

namespace cocalib {
namespace {

FuserParams withRangeNoise(FuserParams params, const RigConfig& rig) {
  if (rig.lidar) params.range_noise_m = rig.lidar->range_noise_m;
  return params;
}

}  // namespace

FuserPipeline::FuserPipeline(const RigConfig& rig, const std::optional<CameraModel>& camera, FuserParams params)
    : fuser_(withRangeNoise(params, rig), rig.imu.noise, {camera, rig.lidar.has_value(), rig.target}) {}

bool FuserPipeline::addImu(const sensor_msgs::Imu& msg) {
  const std::optional<ImuSample> sample = readImu(msg, nullptr);
  if (!sample) {
    notices_.count("imu samples refused");
    return false;
  }
  const StreamGuard::Verdict verdict = guard_.onImu(sample->stamp);
  if (verdict == StreamGuard::Verdict::kDrop) {
    notices_.count("imu samples out of order");
    return false;
  }
  const bool restart = verdict == StreamGuard::Verdict::kRestart;
  if (restart) {
    notices_.count("restarts");
    fuser_.reset();
  }
  fuser_.addImu(*sample);
  return restart;
}

void FuserPipeline::addVisual(VisualKeyframe keyframe) {
  if (!guard_.accepts(keyframe.stamp)) return notices_.count("keyframes of another run");
  notices_.count("visual keyframes");
  fuser_.addVisual(std::move(keyframe));
}

void FuserPipeline::addLidar(LidarKeyframe keyframe) {
  if (!guard_.accepts(keyframe.scan.stamp)) return notices_.count("keyframes of another run");
  notices_.count("lidar keyframes");
  fuser_.addLidar(std::move(keyframe));
}

void FuserPipeline::reset() {
  guard_.reset();
  fuser_.reset();
}

CalibratorDiagnostics FuserPipeline::diagnostics() const {
  CalibratorDiagnostics diagnostics = fuser_.diagnostics();
  for (const auto& [what, number] : notices_.counts()) diagnostics.counts[what] = number;
  return diagnostics;
}

}  // namespace cocalib
