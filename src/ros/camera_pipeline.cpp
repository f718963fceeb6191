#include "cocalib/ros/camera_pipeline.h"

#include <stdexcept>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/image_reader.h"

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
      calibrator_(params, rig.imu.noise, camera, rig.target, rig.guess_T_imu_camera) {
  if (rig.target) board_check_.emplace(*rig.target);
}

void CameraPipeline::addImu(const sensor_msgs::Imu& msg) {
  const ImuStream::Outcome outcome = imu_.take(msg, &notices_);
  if (outcome.restart) calibrator_.reset();
  if (outcome.sample) calibrator_.addImu(*outcome.sample);
}

void CameraPipeline::reset() {
  imu_.reset();
  calibrator_.reset();
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
  if (!imu_.accepts(stamp, topic_, "images", &notices_)) return {};
  if (calibrator_.isTooSoon(stamp)) return {};  // saves the decoding
  std::string problem;
  const std::optional<ImageFrame> image = readImage(msg, &problem);
  if (!image) {
    notices_.count("images refused");
    notices_.warn(topic_ + ": " + problem);
    return {};
  }
  if (!fitsModel(image->gray)) return {};

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
  CalibratorDiagnostics diagnostics = notices_.addTo(calibrator_.diagnostics());
  if (rig_problem_) diagnostics.findings.push_back(*rig_problem_);
  return diagnostics;
}

}  // namespace cocalib
