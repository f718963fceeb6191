#include "cocalib/ros/camera_pipeline.h"

#include <stdexcept>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/image_reader.h"
#include "cocalib/ros/imu_reader.h"

namespace cocalib {
namespace {

const RigConfig::Camera& cameraOf(const RigConfig& rig) {
  if (!rig.camera) throw std::invalid_argument(rig.file + ": the rig has no camera");
  return *rig.camera;
}

}  // namespace

CameraPipeline::CameraPipeline(const RigConfig& rig, const CameraModel& camera, const VisualInertialParams& params)
    : rig_file_(rig.file),
      topic_(cameraOf(rig).topic),
      width_(camera.width()),
      height_(camera.height()),
      least_gap_ns_(toNs(0.9 / params.frame_rate_hz)),
      calibrator_(params, rig.imu.noise, camera, rig.target, rig.guess_T_imu_camera) {
  if (rig.target) board_check_.emplace(*rig.target);
}

void CameraPipeline::addImu(const sensor_msgs::Imu& msg) {
  std::string problem;
  const std::optional<ImuSample> sample = readImu(msg, &problem);
  if (!sample) {
    notices_.count("imu samples refused");
    notices_.warn("imu: " + problem);
    return;
  }
  const StreamGuard::Verdict verdict = guard_.onImu(sample->stamp);
  if (verdict == StreamGuard::Verdict::kDrop) return notices_.count("imu samples out of order");
  if (verdict == StreamGuard::Verdict::kRestart) {
    notices_.count("restarts");
    last_taken_.reset();
    calibrator_.reset();
  }
  calibrator_.addImu(*sample);
}

void CameraPipeline::reset() {
  guard_.reset();
  last_taken_.reset();
  calibrator_.reset();
}

bool CameraPipeline::isTooSoon(TimeNs stamp) const {
  return last_taken_ && stamp > *last_taken_ && stamp - *last_taken_ < least_gap_ns_;
}

bool CameraPipeline::fitsModel(const cv::Mat& gray) {
  if (gray.cols == width_ && gray.rows == height_) return true;
  notices_.count("images of another size");
  const std::string sizes = std::to_string(gray.cols) + " x " + std::to_string(gray.rows) +
                            ", the camera model is for " + std::to_string(width_) + " x " + std::to_string(height_);
  rig_problem_ = rig_file_ + ": pictures on " + topic_ + " are " + sizes + "; correct camera resolution and intrinsics";
  notices_.warn(*rig_problem_);
  return false;
}

template <typename Message>
std::vector<VisualKeyframe> CameraPipeline::addAnyImage(const Message& msg) {
  notices_.count("images");
  const TimeNs stamp = toTimeNs(msg.header.stamp);
  if (!guard_.accepts(stamp)) {
    notices_.count("images out of time");
    notices_.warn(topic_ + ": stamps are seconds away from those of the IMU; are the clocks synchronised?");
    return {};
  }
  // The calibrator would not use it; skipping it here saves the decoding.
  if (isTooSoon(stamp)) return {};
  std::string problem;
  const std::optional<ImageFrame> image = readImage(msg, &problem);
  if (!image) {
    notices_.count("images refused");
    notices_.warn(topic_ + ": " + problem);
    return {};
  }
  if (!fitsModel(image->gray)) return {};
  if (!last_taken_ || stamp > *last_taken_) last_taken_ = stamp;

  std::vector<VisualKeyframe> keyframes = calibrator_.addImage(*image);
  if (board_check_) {
    for (const VisualKeyframe& keyframe : keyframes) {
      if (keyframe.board) board_check_->confirm();
    }
    if (const std::optional<std::string> wrong_size = board_check_->look(*image)) {
      rig_problem_ = rig_file_ + ": " + *wrong_size + "; correct target: cols and rows";
      notices_.warn(*rig_problem_);
    }
  }
  return keyframes;
}

template std::vector<VisualKeyframe> CameraPipeline::addAnyImage(const sensor_msgs::Image&);
template std::vector<VisualKeyframe> CameraPipeline::addAnyImage(const sensor_msgs::CompressedImage&);

CalibratorDiagnostics CameraPipeline::diagnostics() const {
  CalibratorDiagnostics diagnostics = calibrator_.diagnostics();
  for (const auto& [what, number] : notices_.counts()) diagnostics.counts[what] = number;
  return diagnostics;
}

}  // namespace cocalib
