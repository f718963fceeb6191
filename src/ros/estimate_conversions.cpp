#include "cocalib/ros/estimate_conversions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

using RowMajor14d = Eigen::Matrix<double, 14, 14, Eigen::RowMajor>;
using RowMajor6d = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

/// Where a sensor's numbers stand in the joint covariance.
struct Place {
  int pose;
  int offset;
};
Place placeOf(SensorPart part) { return part == SensorPart::kCamera ? Place{0, 12} : Place{6, 13}; }

double finiteOrZero(double value) { return std::isfinite(value) ? value : 0.0; }
Eigen::Vector3d finiteOrZero(const Eigen::Vector3d& v) {
  if (v.allFinite()) return v;
  return Eigen::Vector3d::Zero();
}

/// What all three parts of a message are filled from.
struct Part {
  Pose pose;
  Matrix6d pose_covariance;
  Vector7d offset_covariance;
  double offset_s;
  const SensorVerdict& verdict;
};

bool isFinite(const Part& part) {
  return part.pose.t.allFinite() && part.pose.q.coeffs().allFinite() && part.pose_covariance.allFinite() &&
         part.offset_covariance.allFinite() && std::isfinite(part.offset_s) && part.verdict.sigma.allFinite() &&
         std::isfinite(part.verdict.time_offset_sigma_s);
}

void fillPart(const Part& part, ExtrinsicEstimate* msg) {
  msg->pose.pose.orientation.w = 1.0;
  msg->unobservable = part.verdict.unobservable;
  if (!isFinite(part)) return;
  msg->valid = part.verdict.valid;
  msg->pose.pose = toPoseMsg(part.pose);
  Eigen::Map<RowMajor6d>(msg->pose.covariance.data()) = part.pose_covariance;
  msg->time_offset = part.offset_s;
  Eigen::Map<Vector7d>(msg->time_offset_covariance.data()) = part.offset_covariance;
  Eigen::Map<Vector6d>(msg->sigma.data()) = part.verdict.sigma;
  msg->time_offset_sigma = part.verdict.time_offset_sigma_s;
}

ExtrinsicEstimate commonPart(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics) {
  ExtrinsicEstimate msg;
  msg.header.stamp = toRosTime(estimate.stamp);
  msg.status = toString(estimate.status);
  msg.stage = diagnostics.stage;
  msg.message = estimate.message.empty() ? diagnostics.message : estimate.message;
  msg.findings = diagnostics.findings;
  msg.duration = finiteOrZero(estimate.duration_s);
  msg.gyro_bias = toVectorMsg(finiteOrZero(estimate.gyro_bias));
  msg.accel_bias = toVectorMsg(finiteOrZero(estimate.accel_bias));
  msg.gravity = finiteOrZero(estimate.gravity);
  return msg;
}

SensorVerdict toVerdict(const ExtrinsicEstimate& msg) {
  SensorVerdict verdict;
  verdict.valid = msg.valid;
  verdict.sigma = Eigen::Map<const Vector6d>(msg.sigma.data());
  verdict.time_offset_sigma_s = msg.time_offset_sigma;
  verdict.unobservable = msg.unobservable;
  return verdict;
}

/// The lidar-camera part; its clock offset is the difference of the two sensors' offsets.
ExtrinsicEstimate lidarCameraPart(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics,
                                  const FrameNames& frames) {
  ExtrinsicEstimate msg = commonPart(estimate, diagnostics);
  msg.header.frame_id = frames.lidar;
  msg.child_frame_id = frames.camera;
  const Calibration& calibration = estimate.calibration;
  Vector7d offset_covariance = Vector7d::Zero();
  offset_covariance[6] = estimate.covariance(12, 12) + estimate.covariance(13, 13) - 2.0 * estimate.covariance(12, 13);
  fillPart({calibration.T_lidar_camera(), lidarCameraCovariance(calibration, estimate.covariance), offset_covariance,
            calibration.camera_time_offset_s - calibration.lidar_time_offset_s, estimate.lidar_camera},
           &msg);
  return msg;
}

}  // namespace

Status statusFromString(const std::string& word) {
  for (const Status status : {Status::kUnobservable, Status::kConverging, Status::kConverged}) {
    if (word == toString(status)) return status;
  }
  return Status::kInsufficientData;
}

ExtrinsicEstimate toExtrinsicMsg(const CalibrationEstimate& estimate, SensorPart part,
                                 const CalibratorDiagnostics& diagnostics, const FrameNames& frames) {
  const bool camera = part == SensorPart::kCamera;
  const Calibration& calibration = estimate.calibration;
  const Place place = placeOf(part);
  ExtrinsicEstimate msg = commonPart(estimate, diagnostics);
  msg.header.frame_id = frames.imu;
  msg.child_frame_id = camera ? frames.camera : frames.lidar;
  Vector7d offset_covariance;
  offset_covariance << estimate.covariance.block<6, 1>(place.pose, place.offset),
      estimate.covariance(place.offset, place.offset);
  fillPart({camera ? calibration.T_imu_camera : calibration.T_imu_lidar,
            estimate.covariance.block<6, 6>(place.pose, place.pose), offset_covariance,
            camera ? calibration.camera_time_offset_s : calibration.lidar_time_offset_s,
            camera ? estimate.camera : estimate.lidar},
           &msg);
  return msg;
}

CalibrationEstimate fromExtrinsicMsg(const ExtrinsicEstimate& msg, SensorPart part) {
  const bool camera = part == SensorPart::kCamera;
  const Place place = placeOf(part);
  CalibrationEstimate estimate;
  estimate.status = statusFromString(msg.status);
  estimate.stamp = toTimeNs(msg.header.stamp);
  estimate.duration_s = msg.duration;
  estimate.message = msg.message;
  estimate.gyro_bias = fromVectorMsg(msg.gyro_bias);
  estimate.accel_bias = fromVectorMsg(msg.accel_bias);
  estimate.gravity = msg.gravity;
  (camera ? estimate.calibration.T_imu_camera : estimate.calibration.T_imu_lidar) = fromPoseMsg(msg.pose.pose);
  (camera ? estimate.calibration.camera_time_offset_s : estimate.calibration.lidar_time_offset_s) = msg.time_offset;
  (camera ? estimate.camera : estimate.lidar) = toVerdict(msg);
  const Eigen::Map<const Vector7d> offset_covariance(msg.time_offset_covariance.data());
  estimate.covariance.block<6, 6>(place.pose, place.pose) = Eigen::Map<const RowMajor6d>(msg.pose.covariance.data());
  estimate.covariance.block<6, 1>(place.pose, place.offset) = offset_covariance.head<6>();
  estimate.covariance.block<1, 6>(place.offset, place.pose) = offset_covariance.head<6>().transpose();
  estimate.covariance(place.offset, place.offset) = offset_covariance[6];
  return estimate;
}

CalibrationEstimateMsg toEstimateMsg(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics,
                                     const FrameNames& frames) {
  CalibrationEstimateMsg msg;
  msg.camera = toExtrinsicMsg(estimate, SensorPart::kCamera, diagnostics, frames);
  msg.lidar = toExtrinsicMsg(estimate, SensorPart::kLidar, diagnostics, frames);
  msg.lidar_camera = lidarCameraPart(estimate, diagnostics, frames);
  msg.header = msg.camera.header;
  msg.status = msg.camera.status;
  msg.stage = msg.camera.stage;
  msg.message = msg.camera.message;
  msg.progress = diagnostics.progress;
  msg.findings = diagnostics.findings;
  msg.duration = msg.camera.duration;
  msg.gyro_bias = msg.camera.gyro_bias;
  msg.accel_bias = msg.camera.accel_bias;
  msg.gravity = msg.camera.gravity;
  if (estimate.covariance.allFinite()) Eigen::Map<RowMajor14d>(msg.joint_covariance.data()) = estimate.covariance;
  msg.reprojection_rms_px = finiteOrZero(estimate.quality.reprojection_rms_px);
  msg.lidar_plane_rms_m = finiteOrZero(estimate.quality.lidar_plane_rms_m);
  msg.board_views = estimate.quality.board_views;
  msg.board_lidar_points = estimate.quality.board_lidar_points;
  msg.keyframes = estimate.quality.keyframes;
  return msg;
}

CalibrationEstimate fromEstimateMsg(const CalibrationEstimateMsg& msg) {
  CalibrationEstimate estimate = fromExtrinsicMsg(msg.camera, SensorPart::kCamera);
  const CalibrationEstimate lidar = fromExtrinsicMsg(msg.lidar, SensorPart::kLidar);
  estimate.calibration.T_imu_lidar = lidar.calibration.T_imu_lidar;
  estimate.calibration.lidar_time_offset_s = lidar.calibration.lidar_time_offset_s;
  estimate.lidar = lidar.lidar;
  estimate.lidar_camera = toVerdict(msg.lidar_camera);
  estimate.covariance = Eigen::Map<const RowMajor14d>(msg.joint_covariance.data());
  estimate.quality.reprojection_rms_px = msg.reprojection_rms_px;
  estimate.quality.lidar_plane_rms_m = msg.lidar_plane_rms_m;
  estimate.quality.board_views = msg.board_views;
  estimate.quality.board_lidar_points = msg.board_lidar_points;
  estimate.quality.keyframes = msg.keyframes;
  return estimate;
}

}  // namespace cocalib
