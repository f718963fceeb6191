#pragma once

#include <optional>
#include <unordered_map>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/scenario.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::sim {

/// Pictures within the recording.
int imageCount(const Scenario& scenario);
/// Stamp of picture k on the camera clock; its true time is imageTime().
TimeNs imageStamp(const Scenario& scenario, int k);
/// True time of picture k since the epoch, on the IMU clock [s].
double imageTime(const Scenario& scenario, int k);

/// Where the board's inner corners truly appear in picture k (global shutter).
struct BoardTruth {
  TimeNs stamp = 0;                         ///< camera clock
  std::vector<Eigen::Vector2d> corners_px;  ///< raw pixels in the order of BoardObservation; NaN behind the camera
  std::vector<bool> visible;                ///< inside the image, from the front, and not occluded
  bool complete = false;                    ///< all of them visible
};
BoardTruth trueBoard(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int k);

/// The corners with camera.corner_noise_px, or nothing unless the whole board is visible.
std::optional<BoardObservation> simulateBoard(const Scenario& scenario, const Scene& scene,
                                              const Trajectory& trajectory, int k);

/// Feature tracks without pictures: random points on the room's surfaces (not on the board), each followed until it
/// leaves the view, is occluded, or has lived `max_age_s`; pixel noise is white with camera.track_noise_px.
/// Not thread-safe. Deterministic.
class TrackSimulator {
 public:
  TrackSimulator(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int features = 120,
                 double min_age_s = 1.0, double max_age_s = 2.0);

  /// Observations in picture k; call with k increasing (steps may be skipped).
  std::vector<TrackObservation> observe(int k);

  /// Where track `id` truly is in W.
  const Eigen::Vector3d& landmark(std::uint32_t id) const { return landmarks_.at(id); }

 private:
  struct Track {
    std::uint32_t id;
    Eigen::Vector3d p_W;
    double end_s;
  };
  std::optional<Eigen::Vector2d> see(const Pose& T_W_C, const Eigen::Vector3d& p_W) const;
  void topUp(const Pose& T_W_C, double t);

  const Scenario scenario_;
  const Scene scene_;
  const Trajectory trajectory_;
  CameraModel camera_;
  Pose T_I_C_;
  std::size_t features_;
  double min_age_s_, max_age_s_;
  Random random_;
  std::vector<Track> tracks_;
  std::unordered_map<std::uint32_t, Eigen::Vector3d> landmarks_;
  std::uint32_t next_id_ = 0;
};

}  // namespace cocalib::sim
