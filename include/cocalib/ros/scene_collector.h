#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "cocalib/io/rig_config.h"
#include "cocalib/monitor/overlay_scene.h"

namespace cocalib {

/// Keeps a handful of pictures with the sweeps and the inertial data around them, spread over the run, so that the end
/// of a run can show the best of them. Messages are held as they came and decoded only when shown. Not thread-safe.
class SceneCollector {
 public:
  /// kSpread: scenes spread over the whole run, ever farther apart. kNewest: the last few, for a live picture.
  enum class Keep { kSpread, kNewest };
  SceneCollector(const RigConfig& rig, Keep keep);

  void addImu(const sensor_msgs::Imu& msg);
  void addImage(const sensor_msgs::ImageConstPtr& msg);
  void addImage(const sensor_msgs::CompressedImageConstPtr& msg);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& msg);
  /// States of the IMU as keyframes bring them; a scene takes the one nearest to its picture.
  void addState(const NavState& state);
  void clear();

  /// The scene with the most points in the picture, and the board in it if it was ever seen.
  /// @param T_W_B  board in the world of the states, if known
  std::optional<OverlayScene> best(const Calibration& calibration, const CameraModel& camera,
                                   const std::optional<Pose>& T_W_B) const;
  /// Up to `count` scenes, spread evenly over those that are kept and have a state.
  std::vector<OverlayScene> some(std::size_t count) const;
  /// The newest scene that has a state, or the newest at all.
  std::optional<OverlayScene> newest() const;
  /// The newest scene that has a state and whose picture has this property.
  std::optional<OverlayScene> newest(const std::function<bool(TimeNs stamp)>& wanted) const;

 private:
  struct Candidate {
    TimeNs stamp = 0;
    sensor_msgs::ImageConstPtr image;
    sensor_msgs::CompressedImageConstPtr compressed;
    sensor_msgs::PointCloud2ConstPtr cloud;
    std::vector<ImuSample> imu;
    std::optional<NavState> state;
  };
  void startCandidate(Candidate candidate);
  void makeRoom();
  std::optional<OverlayScene> decode(const Candidate& candidate) const;

  RigConfig rig_;
  Keep keep_;
  TimeNs period_ns_;
  std::deque<ImuSample> recent_imu_;
  std::deque<sensor_msgs::PointCloud2ConstPtr> recent_clouds_;
  std::vector<Candidate> candidates_;  // in order of time; the last one may still lack inertial data behind it
};

}  // namespace cocalib
