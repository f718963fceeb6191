#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib::sim {

/// Where the rig is moved.
enum class Place {
  kRoom,      ///< one room, 10 x 8 x 4 m
  kCorridor,  ///< without end: two walls, floor and ceiling; the way along it cannot be seen
  kWall,      ///< a single facade
  kBuilding,  ///< rooms around a court of 24 x 18 m, with doors; the rig is driven through them, once around in 55 s
};

/// How the rig is moved; all but kStatic are sums of sinusoids of 0.06 to 1.2 Hz. In a building they are added to the
/// drive.
enum class Motion {
  kFull,             ///< all six axes, lively
  kMild,             ///< all six axes, slow and small
  kPlanar,           ///< x, y and yaw only, like a ground robot
  kUpright,          ///< x, y, z and yaw: never tilted
  kRotationOnly,     ///< turning about a fixed point
  kTranslationOnly,  ///< shifting without turning
  kStatic,           ///< standing still
};

/// How the lidar scans: number of rings, elevations, firing times.
enum class LidarModel { kVlp16, kOs1_32, kOs1_64, kOs1_128, kXt32, kRs32, kLivox };

/// Names and types of the fields of the published cloud.
enum class CloudDialect { kVelodyne, kOuster, kHesai, kRobosense, kLivox, kLivoxOffset, kNoTime };

/// Everything that defines one simulated recording. The defaults are the rig of the paper's Tables I and II.
/// Same scenario, same seed: the same measurements, bit by bit.
struct Scenario {
  std::string name = "table1_full";
  std::uint64_t seed = 1;  ///< 1: the tabulated motion; others move differently
  double duration_s = 60.0;
  TimeNs epoch = TimeNs{1700000000} * 1000000000;  ///< IMU clock at the trajectory's time 0
  double gravity = 9.80665;                        ///< [m/s^2]
  Place place = Place::kRoom;
  Motion motion = Motion::kFull;
  double ramp_s = 1.5;        ///< the motion swells from standstill within this time
  double planar_for_s = 0;    ///< z, roll and pitch rest for so long before they swell too
  double parked_after_s = 0;  ///< > 0: the motion fades from then on, within ramp_s, and the rig stands; in no building

  struct Imu {
    double rate_hz = 400.0;
    double gyro_noise_density = 1.745329e-4;  ///< 0.01 deg/s/sqrt(Hz) [rad/s/sqrt(Hz)]
    double accel_noise_density = 5.88399e-4;  ///< 60 ug/sqrt(Hz) [m/s^2/sqrt(Hz)]
    double gyro_bias = 4.848137e-5;           ///< typical size per axis, 10 deg/h [rad/s]
    double accel_bias = 1.4709975e-4;         ///< typical size per axis, 15 ug [m/s^2]
    double gyro_bias_walk = 0.0;              ///< [rad/s^2/sqrt(Hz)]
    double accel_bias_walk = 0.0;             ///< [m/s^3/sqrt(Hz)]
  } imu;

  struct Camera {
    bool present = true;
    double rate_hz = 50.0;
    std::string model = "pinhole-radtan";                    ///< or "pinhole-equi"
    Eigen::Vector4d intrinsics{460.0, 460.0, 375.5, 239.5};  ///< fu, fv, cu, cv [px]
    std::vector<double> distortion{-0.12, 0.04, 0.0006, -0.0004};
    int width = 752, height = 480;
    Eigen::Vector3d mounting_rpy{-0.16, -0.16, -0.04};  ///< of the camera body (x forward, z up) in the IMU frame [rad]
    double optical_roll = 0.0;                          ///< further turn about the optical axis [rad]
    Eigen::Vector3d translation{0.1, 0.0, 0.0};         ///< of the camera in the IMU frame [m]
    double time_offset_s = 0.0;                         ///< t_imu = t_camera + time_offset
    double blur_px = 0.5;                               ///< lens blur, 1 sigma of a Gaussian
    double noise = 2.0;                                 ///< pixel noise, 1 sigma, of 255 grey levels
    double exposure_s = 0.0;                            ///< > 0: motion blur; the stamp is the middle of the exposure
    double line_delay_s = 0.0;                          ///< > 0: rolling shutter; the stamp is that of the middle row
    std::string transport = "raw";                      ///< "raw" | "jpeg" | "png"
    std::string topic = "/camera/image_raw", info_topic = "/camera/camera_info", frame = "camera_optical_frame";
    /// What goes wrong with the pictures; corners and tracks made without pictures know nothing of it.
    struct Faults {
      double blackout_start_s = 0.0, blackout_s = 0.0;  ///< pictures are black for so long
      double brightness_period_s = 0.0;                 ///< > 0: the brightness steps to another level this often
      double brightness_factor = 2.0;                   ///< levels lie between 1 / factor and factor times the scene's
      double dropped = 0.0;                             ///< share of the pictures that are lost
      double moving_object = 0.0;                       ///< share of the width behind something that moves by itself
    } faults;
    double corner_noise_px = 0.15;  ///< measurement-level corners only, 1 sigma per axis
    double track_noise_px = 0.7;    ///< measurement-level tracks only, 1 sigma per axis

    /// @throws std::invalid_argument for a model or coefficients that do not exist
    CameraModel cameraModel() const;
    Pose T_imu_camera() const;  ///< true T_I_C
  } camera;

  struct Lidar {
    LidarModel model = LidarModel::kVlp16;
    CloudDialect dialect = CloudDialect::kVelodyne;
    double rate_hz = 10.0;
    double range_noise_m = 0.03;  ///< 1 sigma
    double min_range_m = 0.5, max_range_m = 100.0;
    double max_incidence_rad = 1.4835;               ///< no return from flatter beams (85 deg)
    bool keep_no_return = false;                     ///< publish beams without return as NaN
    Eigen::Vector3d mounting_rpy{0.16, 0.16, 0.16};  ///< [rad]
    Eigen::Vector3d translation{0.1, 0.0, -0.08};    ///< [m]
    double time_offset_s = 0.0;                      ///< t_imu = t_lidar + time_offset
    std::string topic = "/velodyne_points", frame = "lidar_link";

    Pose T_imu_lidar() const;  ///< true T_I_L
  } lidar;

  struct Board {
    bool present = true;
    int cols = 8, rows = 6;  ///< inner corners
    double square_m = 0.10;
    double width_m = 1.0, height_m = 0.8;
    double distance_m = 3.0;                  ///< in front of the middle of the motion
    Eigen::Vector3d tilt_rpy{0.2, 0.3, 0.2};  ///< turned out of the plane that faces the rig [rad]

    BoardGeometry geometry() const;
  } board;

  std::string imu_topic = "/imu/data", imu_frame = "imu_link";

  /// @throws std::invalid_argument naming the key and what is allowed
  void validate() const;
};

/// R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Matrix3d rotationFromRpy(const Eigen::Vector3d& rpy);

/// Reads a scenario; keys that are absent keep their defaults.
/// @throws std::runtime_error with one line: file, key, what is wrong and what is allowed
Scenario loadScenario(const std::string& path);

/// Same, from text; `path` is used in messages only.
Scenario parseScenario(const std::string& yaml, const std::string& path);

}  // namespace cocalib::sim
