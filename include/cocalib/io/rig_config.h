#pragma once

#include <optional>
#include <string>

#include "cocalib/estimation/estimate.h"
#include "cocalib/geometry/pose.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib {

/// Overrides of what the point-cloud reader recognises by itself; empty: recognise.
struct PointTimeOverride {
  std::string field;  ///< name of the field that carries the time of a point; "none": there is none
  std::string unit;   ///< "s" | "ms" | "us" | "ns"
  std::string stamp;  ///< the header stamp is the time of the "first" | "last" point
};

/// The rig file: what the user says of the robot. Filled by loadRigFile(), which validates it.
struct RigConfig {
  struct Imu {
    std::string topic, frame = "imu_link";
    ImuNoise noise;
  };
  struct Camera {
    std::string topic, info_topic, frame = "camera_optical_frame";
    std::optional<CameraModel> model;  ///< given in the file; otherwise read from info_topic
  };
  struct Lidar {
    std::string topic, frame = "lidar_link";
    double range_noise_m = 0.03;  ///< 1 sigma
    double min_range_m = 0.5, max_range_m = 100.0;
    PointTimeOverride point_time;
    double scan_period_s = 0.1;  ///< used only where the cloud carries no point times
  };

  std::string file;  ///< where it was read from, for messages
  std::string text;  ///< what the file says, for the report
  Imu imu;
  std::optional<Camera> camera;
  std::optional<Lidar> lidar;
  std::optional<BoardGeometry> target;
  std::optional<Pose> guess_T_imu_camera, guess_T_imu_lidar;
  std::optional<CalibrationEstimate> earlier;  ///< result of an earlier run, to go on from
};

}  // namespace cocalib
