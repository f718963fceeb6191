#include "cocalib/monitor/overlay_scene.h"

#include <algorithm>

namespace cocalib {
namespace {

/// Rotation of the IMU relative to one instant, by integrating the gyro to both sides of it.
class GyroPath {
 public:
  GyroPath(const std::vector<ImuSample>& imu, const Eigen::Vector3d& bias, TimeNs origin) : origin_(origin) {
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    for (std::size_t i = 0; i < imu.size(); ++i) {
      if (i > 0) {
        const double dt = toSeconds(imu[i].stamp - imu[i - 1].stamp);
        q = q * expSo3((0.5 * (imu[i].gyro + imu[i - 1].gyro) - bias) * dt);
      }
      knots_.push_back({imu[i].stamp, q});
    }
    q_start_origin_ = fromStart(origin);
  }

  /// R_I(origin)_I(stamp)
  Eigen::Quaterniond rotation(TimeNs stamp) const { return q_start_origin_.conjugate() * fromStart(stamp); }
  TimeNs origin() const { return origin_; }

 private:
  struct Knot {
    TimeNs stamp;
    Eigen::Quaterniond q_start_here;
  };

  Eigen::Quaterniond fromStart(TimeNs stamp) const {
    if (knots_.empty()) return Eigen::Quaterniond::Identity();
    const auto after = std::upper_bound(knots_.begin(), knots_.end(), stamp,
                                        [](TimeNs time, const Knot& knot) { return time < knot.stamp; });
    if (after == knots_.begin()) return knots_.front().q_start_here;
    if (after == knots_.end()) return knots_.back().q_start_here;
    const auto before = after - 1;
    const double part = static_cast<double>(stamp - before->stamp) / static_cast<double>(after->stamp - before->stamp);
    return before->q_start_here.slerp(part, after->q_start_here);
  }

  TimeNs origin_;
  std::vector<Knot> knots_;
  Eigen::Quaterniond q_start_origin_ = Eigen::Quaterniond::Identity();
};

/// How the IMU stood at times near the picture, seen from where it stood at the picture.
class MotionAroundPicture {
 public:
  MotionAroundPicture(const OverlayScene& scene, const Calibration& calibration)
      : image_time_(scene.image.stamp + toNs(calibration.camera_time_offset_s)),
        gyro_(scene.imu, scene.state ? scene.state->gyro_bias : Eigen::Vector3d::Zero(), image_time_) {
    if (!scene.state) return;
    // Velocity at the state, in the frame of the IMU at the picture.
    const Eigen::Quaterniond q_image_state = gyro_.rotation(scene.state->stamp);
    velocity_ = q_image_state * (scene.state->T_W_I.q.conjugate() * scene.state->v_W);
  }

  Pose T_image_at(TimeNs stamp) const { return {gyro_.rotation(stamp), velocity_ * toSeconds(stamp - image_time_)}; }

 private:
  TimeNs image_time_;
  GyroPath gyro_;
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();
};

}  // namespace

std::vector<Eigen::Vector3d> pointsInCamera(const OverlayScene& scene, const Calibration& calibration) {
  const MotionAroundPicture motion(scene, calibration);
  const Pose T_C_I = calibration.T_imu_camera.inverse();
  const TimeNs scan_time = scene.scan.stamp + toNs(calibration.lidar_time_offset_s);
  std::vector<Eigen::Vector3d> points_C;
  points_C.reserve(scene.scan.points.size());
  for (const LidarPoint& point : scene.scan.points) {
    const Eigen::Vector3d p_I = calibration.T_imu_lidar * point.p.cast<double>();
    points_C.push_back(T_C_I * (motion.T_image_at(scan_time + toNs(point.offset_s)) * p_I));
  }
  return points_C;
}

std::optional<Pose> boardInCamera(const OverlayScene& scene, const Calibration& calibration,
                                  const std::optional<Pose>& T_W_B) {
  if (!T_W_B || !scene.state) return std::nullopt;
  const MotionAroundPicture motion(scene, calibration);
  const Pose T_state_B = scene.state->T_W_I.inverse() * *T_W_B;
  return calibration.T_imu_camera.inverse() * motion.T_image_at(scene.state->stamp) * T_state_B;
}

}  // namespace cocalib
