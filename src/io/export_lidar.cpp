#include "export_formats.h"
#include "text_format.h"

// Which way each of these programs' transforms goes is what its source does with them: the comments in the files that
// they ship say the opposite in places.
namespace cocalib {
namespace {

/// extrinsicTrans and extrinsicRot as LIO-SAM and LVI-SAM use them.
std::string formatSamExtrinsics(const Pose& T_lidar_imu, const Eigen::Matrix3d& extrinsic_rpy) {
  return "  extrinsicTrans: " + formatList(T_lidar_imu.t) + "\n  extrinsicRot: " + formatRows(T_lidar_imu.R()) +
         "\n  extrinsicRPY: " + formatRows(extrinsic_rpy) + "\n";
}

ExportComment describeSam(const ExportSource& source, const std::string& first, const Pose& T_lidar_imu) {
  ExportComment comment("# ");
  comment.say(first).sayStatus(source.estimate);
  comment.say("extrinsicRot and extrinsicTrans take coordinates in the IMU frame to the lidar frame:");
  comment.say("p_lidar = extrinsicRot * p_imu + extrinsicTrans.").work(T_lidar_imu, "IMU", "lidar");
  return comment;
}

std::string describeUnusedOffset(const ExportSource& source) {
  ExportComment comment("# ");
  comment.say("There is no key for the lidar's clock offset. It is " +
              formatNumber(source.estimate.calibration.lidar_time_offset_s) + " s (t_imu = t_lidar + offset);");
  comment.say("where it matters, correct the stamps in the driver.");
  return comment.text();
}

}  // namespace

std::string formatLioSam(const ExportSource& source) {
  const Pose T_lidar_imu = source.estimate.calibration.T_imu_lidar.inverse();
  ExportComment comment = describeSam(source, "Block for LIO-SAM's params.yaml.", T_lidar_imu);
  comment.say("extrinsicRPY turns the IMU's own orientation and is inverted by LIO-SAM before use, so it is the same");
  comment.say("matrix; versions whose utility.h says extQRPY = Eigen::Quaterniond(extRPY), without .inverse(), need");
  comment.say("its transpose.");
  return comment.text() + describeUnusedOffset(source) + "lio_sam:\n" +
         formatSamExtrinsics(T_lidar_imu, T_lidar_imu.R());
}

std::string formatLviSamLidar(const ExportSource& source) {
  const Pose T_lidar_imu = source.estimate.calibration.T_imu_lidar.inverse();
  ExportComment comment = describeSam(source, "Block for LVI-SAM's params_lidar.yaml.", T_lidar_imu);
  comment.say(
      "extrinsicRPY turns the IMU's own orientation from the right, R_world_lidar = R_world_imu * extrinsicRPY,");
  comment.say("so it takes coordinates in the lidar frame to the IMU frame: the transpose of extrinsicRot.");
  return comment.text() + describeUnusedOffset(source) + "lvi_sam:\n" +
         formatSamExtrinsics(T_lidar_imu, T_lidar_imu.R().transpose());
}

std::string formatFastLio(const ExportSource& source) {
  const Calibration& calibration = source.estimate.calibration;
  ExportComment comment("# ");
  comment.say("Block for a configuration file of FAST-LIO.").sayStatus(source.estimate);
  comment.say("extrinsic_R and extrinsic_T take coordinates in the lidar frame to the IMU frame:");
  comment.say("p_imu = extrinsic_R * p_lidar + extrinsic_T.").work(calibration.T_imu_lidar, "lidar", "IMU");
  comment.say("time_offset_lidar_to_imu [s]: t_imu = t_lidar + time_offset_lidar_to_imu.");
  return comment.text() + "common:\n  time_sync_en: false\n  time_offset_lidar_to_imu: " +
         formatNumber(calibration.lidar_time_offset_s) +
         "\nmapping:\n  extrinsic_est_en: false\n  extrinsic_T: " + formatList(calibration.T_imu_lidar.t) +
         "\n  extrinsic_R: " + formatRows(calibration.T_imu_lidar.R()) + "\n";
}

}  // namespace cocalib
