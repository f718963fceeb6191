#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"

namespace cocalib {

/// One inertial sample: angular rate and specific force in the IMU frame,
/// accel = R_I_W (a_W - g_W) with g_W = (0, 0, -g).
struct ImuSample {
  TimeNs stamp = 0;
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  ///< [m/s^2]
};

/// One decoded picture.
struct ImageFrame {
  TimeNs stamp = 0;  ///< camera clock; what the driver says
  cv::Mat gray;      ///< CV_8UC1
};

/// One return of the lidar, in the lidar frame as it stood when the beam was fired.
struct LidarPoint {
  Eigen::Vector3f p = Eigen::Vector3f::Zero();  ///< [m]
  float offset_s = 0.0F;                        ///< time since the scan's stamp, >= 0
  std::int16_t ring = -1;                       ///< laser number, bottom up where the driver says so; -1: unknown
};

/// One sweep, raw: not deskewed, points in the order the driver gives, without NaN, within the range limits.
struct LidarScan {
  TimeNs stamp = 0;  ///< of the first point, lidar clock
  std::vector<LidarPoint> points;
};

/// A navigation state: pose, velocity and biases of the IMU at one instant of the IMU clock.
struct NavState {
  TimeNs stamp = 0;                                      ///< IMU clock
  Pose T_W_I;                                            ///< W gravity-aligned, z up
  Eigen::Vector3d v_W = Eigen::Vector3d::Zero();         ///< velocity of I in W [m/s]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();  ///< [m/s^2]
};

/// A natural feature seen in one picture.
struct TrackObservation {
  std::uint32_t id = 0;                          ///< unique over the run
  Eigen::Vector2f px = Eigen::Vector2f::Zero();  ///< raw (distorted) pixel, centre of the first pixel is (0, 0)
};

/// The chessboard in one picture: all inner corners, row by row from the board's origin corner
/// (index = row * cols + col), so corner i stands at (col * square, row * square, 0) in frame B.
struct BoardObservation {
  std::vector<Eigen::Vector2f> corners_px;  ///< raw (distorted) pixels; cols * rows of them
};

/// What the visual front end hands on for one picture.
struct VisualKeyframe {
  TimeNs stamp = 0;  ///< camera clock
  std::vector<TrackObservation> tracks;
  std::optional<BoardObservation> board;
  std::optional<NavState> state;  ///< where the visual-inertial calibrator believes the IMU was, in its own world
};

/// What the lidar front end hands on for one sweep.
struct LidarKeyframe {
  LidarScan scan;
  std::optional<NavState> state;  ///< where the lidar-inertial calibrator believes the IMU was, in its own world
};

/// The chessboard as the rig file describes it. Frame B: origin at the first inner corner,
/// x along columns, y along rows, z = x cross y (into the board as the camera sees it).
struct BoardGeometry {
  int cols = 0;                    ///< inner corners along x
  int rows = 0;                    ///< inner corners along y
  double square_m = 0.0;           ///< side of one square [m]
  std::optional<double> width_m;   ///< outer edges of the plate along x [m]
  std::optional<double> height_m;  ///< outer edges of the plate along y [m]

  Eigen::Vector3d corner(int index) const { return {(index % cols) * square_m, (index / cols) * square_m, 0.0}; }
  int cornerCount() const { return cols * rows; }
};

}  // namespace cocalib
