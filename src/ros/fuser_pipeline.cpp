#include "cocalib/ros/fuser_pipeline.h"

#include <utility>

namespace cocalib {
namespace {

FuserParams adapted(FuserParams params, const RigConfig& rig) {
  if (rig.lidar) params.range_noise_m = rig.lidar->range_noise_m;
  if (rig.earlier) params.prior = priorFrom(*rig.earlier);
  return params;
}

}  // namespace

FuserPipeline::FuserPipeline(const RigConfig& rig, const std::optional<CameraModel>& camera, FuserParams params)
    : params_(adapted(params, rig)),
      imu_noise_(rig.imu.noise),
      inputs_({camera, rig.lidar.has_value(), rig.target}),
      fuser_(params_, imu_noise_, inputs_) {}

bool FuserPipeline::addImu(const sensor_msgs::Imu& msg) {
  const ImuStream::Outcome outcome = imu_.take(msg, &notices_);
  if (outcome.restart) {
    watch_.reset();
    fuser_.reset();
  }
  if (!outcome.sample) return false;
  if (watch_)
    watch_->addImu(*outcome.sample);
  else
    fuser_.addImu(*outcome.sample);
  return outcome.restart;
}

void FuserPipeline::addVisual(VisualKeyframe keyframe) {
  if (!imu_.accepts(keyframe.stamp)) return notices_.count("keyframes of another run");
  notices_.count("visual keyframes");
  if (watch_) return watch_->addVisual(std::move(keyframe));
  fuser_.addVisual(std::move(keyframe));
}

void FuserPipeline::addLidar(LidarKeyframe keyframe) {
  if (!imu_.accepts(keyframe.scan.stamp)) return notices_.count("keyframes of another run");
  notices_.count("lidar keyframes");
  if (watch_) return watch_->addLidar(std::move(keyframe));
  fuser_.addLidar(std::move(keyframe));
}

void FuserPipeline::reset() {
  imu_.reset();
  watch_.reset();
  fuser_.reset();
}

void FuserPipeline::freeze() {
  if (!watch_) watch_.emplace(MountingWatch::Params(), params_, imu_noise_, inputs_, fuser_.estimate());
}

std::vector<MountingChange> FuserPipeline::watch() {
  if (!watch_) return {};
  return watch_->examine();
}

CalibratorDiagnostics FuserPipeline::diagnostics() const {
  CalibratorDiagnostics diagnostics = notices_.addTo(fuser_.diagnostics());
  if (watch_) {
    diagnostics.stage = "frozen";
    diagnostics.counts["looks at the mountings"] = static_cast<std::uint64_t>(watch_->pieces());
  }
  return diagnostics;
}

}  // namespace cocalib
