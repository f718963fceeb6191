#include "export_formats.h"
#include "text_format.h"

// Which way each of these programs' transforms goes is what its source does with them, not what its comments say.
namespace cocalib {
namespace {

std::string formatRowsOfPose(const Pose& T, const std::string& indent) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = T.R();
  matrix.topRightCorner<3, 1>() = T.t;
  std::string text;
  for (int row = 0; row < 4; ++row) text += indent + "- " + formatList(matrix.row(row).transpose()) + "\n";
  return text;
}

/// Lens, resolution and topic as Kalibr's camera chains have them.
std::string formatKalibrLens(const ExportSource& source, const std::string& indent) {
  const CameraModel& camera = *source.camera;
  const std::optional<Eigen::Vector4d> four = fourCoefficients(camera);
  std::string text = indent + "camera_model: pinhole\n";
  if (four) {
    const bool equidistant = camera.distortion() == CameraModel::Distortion::kEquidistant;
    text += indent + "distortion_coeffs: " + formatList(*four) + "\n";
    text += indent + "distortion_model: " + (equidistant ? "equidistant" : "radtan") + "\n";
  } else {
    text += indent + "# This lens has more coefficients than the four that this format knows: distortion_coeffs and\n";
    text += indent + "# distortion_model are left out. Calibrate the lens with four, and give these to cocalib too.\n";
  }
  text += indent + "intrinsics: " + formatList(camera.intrinsics()) + "\n";
  text += indent + "resolution: [" + std::to_string(camera.width()) + ", " + std::to_string(camera.height()) + "]\n";
  return text + indent + "rostopic: " + source.rig.camera->topic + "\n";
}

/// model_type and what follows from it, as VINS-Mono and LVI-SAM read them (camodocal).
std::string formatCamodocalLens(const CameraModel& camera) {
  const std::optional<Eigen::Vector4d> four = fourCoefficients(camera);
  const Eigen::Vector4d& f = camera.intrinsics();
  const std::string size =
      "image_width: " + std::to_string(camera.width()) + "\nimage_height: " + std::to_string(camera.height()) + "\n";
  if (!four) {
    return size +
           "# This lens has more coefficients than the four that this program knows: model_type, "
           "distortion_parameters\n"
           "# and projection_parameters are left out.\n";
  }
  const auto line = [](const char* key, double value) {
    return "   " + std::string(key) + ": " + formatNumber(value) + "\n";
  };
  if (camera.distortion() == CameraModel::Distortion::kEquidistant) {
    return "model_type: KANNALA_BRANDT\ncamera_name: camera\n" + size + "projection_parameters:\n" +
           line("k2", (*four)[0]) + line("k3", (*four)[1]) + line("k4", (*four)[2]) + line("k5", (*four)[3]) +
           line("mu", f[0]) + line("mv", f[1]) + line("u0", f[2]) + line("v0", f[3]);
  }
  return "model_type: PINHOLE\ncamera_name: camera\n" + size + "distortion_parameters:\n" + line("k1", (*four)[0]) +
         line("k2", (*four)[1]) + line("p1", (*four)[2]) + line("p2", (*four)[3]) + "projection_parameters:\n" +
         line("fx", f[0]) + line("fy", f[1]) + line("cx", f[2]) + line("cy", f[3]);
}

std::string formatOpenCvMatrix(const std::string& name, int cols, const std::string& data) {
  return name + ": !!opencv-matrix\n   rows: 3\n   cols: " + std::to_string(cols) + "\n   dt: d\n   data: " + data +
         "\n";
}

/// Mounting and clock of the camera as VINS-Mono and LVI-SAM read them.
std::string formatVinsMounting(const ExportSource& source) {
  const Calibration& calibration = source.estimate.calibration;
  return "estimate_extrinsic: 0\n" +
         formatOpenCvMatrix("extrinsicRotation", 3, formatRows(calibration.T_imu_camera.R())) +
         formatOpenCvMatrix("extrinsicTranslation", 1, formatList(calibration.T_imu_camera.t)) +
         "estimate_td: 0\ntd: " + formatNumber(calibration.camera_time_offset_s) + "  # s, t_imu = t_camera + td\n";
}

/// Lidar to camera as LVI-SAM wants it: to a camera frame with ROS axes (x forward, y left, z up), as x y z and fixed
/// roll pitch yaw.
std::string formatLidarToCamera(const Pose& T_forward_lidar) {
  const Eigen::Vector3d rpy = rollPitchYaw(T_forward_lidar.R());
  std::string text;
  const char* axes[] = {"x", "y", "z"};
  for (int i = 0; i < 3; ++i) {
    text += "lidar_to_cam_t" + std::string(axes[i]) + ": " + formatNumber(T_forward_lidar.t[i]) + "\n";
  }
  for (int i = 0; i < 3; ++i) text += "lidar_to_cam_r" + std::string(axes[i]) + ": " + formatNumber(rpy[i]) + "\n";
  return text;
}

}  // namespace

std::string formatKalibrChain(const ExportSource& source) {
  const Pose T_cam_imu = source.estimate.calibration.T_imu_camera.inverse();
  ExportComment comment("# ");
  comment.say("Kalibr camchain-imucam.yaml.").sayStatus(source.estimate);
  comment.say("T_cam_imu takes coordinates in the IMU frame to the camera frame: p_cam = T_cam_imu * p_imu.");
  comment.work(T_cam_imu, "IMU", "camera").say("timeshift_cam_imu [s]: t_imu = t_cam + timeshift_cam_imu.");
  return comment.text() + "cam0:\n  T_cam_imu:\n" + formatRowsOfPose(T_cam_imu, "  ") + "  cam_overlaps: []\n" +
         formatKalibrLens(source, "  ") +
         "  timeshift_cam_imu: " + formatNumber(source.estimate.calibration.camera_time_offset_s) + "\n";
}

std::string formatOpenVins(const ExportSource& source) {
  const Pose& T_imu_cam = source.estimate.calibration.T_imu_camera;
  ExportComment comment("# ");
  comment.say("OpenVINS kalibr_imucam_chain.yaml (relative_config_imucam of estimator_config.yaml).");
  comment.sayStatus(source.estimate);
  comment.say("T_imu_cam takes coordinates in the camera frame to the IMU frame: p_imu = T_imu_cam * p_cam.");
  comment.work(T_imu_cam, "camera", "IMU").say("timeshift_cam_imu [s]: t_imu = t_cam + timeshift_cam_imu.");
  // OpenCV reads it, and wants its own first line before any comment.
  return "%YAML:1.0\n" + comment.text() + "cam0:\n  T_imu_cam:\n" + formatRowsOfPose(T_imu_cam, "    ") +
         "  cam_overlaps: []\n" + formatKalibrLens(source, "  ") +
         "  timeshift_cam_imu: " + formatNumber(source.estimate.calibration.camera_time_offset_s) + "\n";
}

std::string formatVinsMono(const ExportSource& source) {
  ExportComment comment("# ");
  comment.say("Block for VINS-Mono's configuration file.").sayStatus(source.estimate);
  comment.say("extrinsicRotation and extrinsicTranslation take coordinates in the camera frame to the IMU frame:");
  comment.say("p_imu = extrinsicRotation * p_cam + extrinsicTranslation.");
  comment.work(source.estimate.calibration.T_imu_camera, "camera", "IMU");
  return "%YAML:1.0\n" + comment.text() + "imu_topic: \"" + source.rig.imu.topic + "\"\nimage_topic: \"" +
         source.rig.camera->topic + "\"\n" + formatCamodocalLens(*source.camera) + formatVinsMounting(source);
}

std::string formatLviSamCamera(const ExportSource& source) {
  const Calibration& calibration = source.estimate.calibration;
  Eigen::Matrix3d R_forward_optical;
  R_forward_optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Pose T_forward_optical = {Eigen::Quaterniond(R_forward_optical), Eigen::Vector3d::Zero()};
  const Pose T_forward_lidar = T_forward_optical * calibration.T_imu_camera.inverse() * calibration.T_imu_lidar;
  ExportComment comment("# ");
  comment.say("Block for LVI-SAM's params_camera.yaml.").sayStatus(source.estimate);
  comment.say("extrinsicRotation and extrinsicTranslation take coordinates in the camera frame to the IMU frame:");
  comment.say("p_imu = extrinsicRotation * p_cam + extrinsicTranslation.");
  comment.work(calibration.T_imu_camera, "camera", "IMU");
  comment.say(
      "lidar_to_cam takes coordinates in the lidar frame to the camera frame with ROS axes (x forward, y left,");
  comment.say("z up), R = Rz(rz) Ry(ry) Rx(rx).").work(T_forward_lidar, "lidar", "camera (ROS axes)");
  comment.say("LVI-SAM itself takes this frame for its vins_body_ros, the IMU turned by q_cam_to_lidar of its");
  comment.say("visualization.cpp: set that rotation for your rig too.");
  return "%YAML:1.0\n" + comment.text() + formatLidarToCamera(T_forward_lidar) + formatCamodocalLens(*source.camera) +
         formatVinsMounting(source);
}

}  // namespace cocalib
