#pragma once

#include <optional>

#include "cocalib/estimation/camera_group.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/lidar_group.h"
#include "cocalib/estimation/window_state.h"

namespace cocalib {

/// What is known before any data, 1 sigma each; centred on the state at reset().
struct WindowPriors {
  double extrinsic_translation_m = 1.0;
  double extrinsic_rotation_rad = 0.5;
  double time_offset_s = 0.1;
  double gravity = 0.03;     ///< of its magnitude over the earth and with height [m/s^2]
  double gyro_bias = 0.2;    ///< [rad/s]
  double accel_bias = 0.5;   ///< [m/s^2]
  double outline_m = 0.002;  ///< of the plate's edges where the rig file gives its size
};

/// An inertial window: a chain of IMU states to which visual and lidar factors attach, with both mountings, clock
/// offsets, gravity, the board and the planes as unknowns. The one estimator behind all three calibrators (paper Eq. 3,
/// 6, 10).
///
/// Use: addNode()s in order of time, addFrame() and addScan(), relink(), optimize(), then calibrationCovariance().
/// Not thread-safe (it uses two threads inside; results do not depend on timing).
class InertialWindow {
 public:
  struct Params {
    ImuNoise imu_noise;
    std::optional<CameraGroup::Params> camera;
    std::optional<LidarGroup::Params> lidar;
    PlaneMap::Params plane_map;
    WindowPriors priors;
    double max_node_spacing_s = 0.05;
  };
  explicit InertialWindow(const Params& params);

  /// 1 sigma of both sensors' positions about the start [m], from the next reset() on; params' own until then.
  void setTranslationPrior(double sigma_m) { params_.priors.extrinsic_translation_m = sigma_m; }

  /// Starts over with a first node and a start for everything shared. The node fixes position and heading.
  void reset(const NavState& first, const Calibration& calibration, double gravity);

  ImuBuffer& imu() { return imu_; }
  const ImuBuffer& imu() const { return imu_; }
  const WindowState& state() const { return state_; }
  const CameraGroup* camera() const { return camera_ ? &*camera_ : nullptr; }
  const LidarGroup* lidar() const { return lidar_ ? &*lidar_ : nullptr; }
  const InertialChain& chain() const { return chain_; }
  const PlaneMap& planeMap() const { return plane_map_; }
  bool boardKnown() const { return board_known_; }

  /// Appends a node; one closer than a third of the node spacing to the last, or before it, is left out.
  void addNode(const NavState& state);
  /// Appends nodes up to `stamp`, spaced evenly, propagated from the last one.
  void extendTo(TimeNs stamp);
  void addFrame(const VisualKeyframe& keyframe) { camera_->addFrame(keyframe); }
  void addScan(std::shared_ptr<const LidarScan> scan) { lidar_->addScan(std::move(scan)); }

  /// Makes the inertial segments of new nodes, so that poses can be asked for; relink() does it too.
  void updateChain() { chain_.update(state_.nodes, imu_); }
  /// Associates: inertial segments, frames and landmarks, planes and lidar points.
  /// @param rebuild_planes  find the planes anew from all scans (only before anything was marginalized)
  /// @param slack_m         uncertainty of the current poses, for the gates
  /// @param all_points      every lidar point: for a last round, at twice the cost
  void relink(bool rebuild_planes, double slack_m, bool all_points = false);

  /// Sets the noise of corners, tracks and ranges to what their residuals show; call it after optimize() and before
  /// marginalizing.
  void learnNoise() {
    if (camera_ && camera_->learnNoise()) solved_.reset();  // its information was that of another noise
    if (lidar_) lidar_->learnRangeNoise();
  }

  /// Starts from the noise of corners and tracks that another window has learnt.
  void adoptNoise(const InertialWindow& other) {
    if (camera_ && other.camera_) camera_->adoptNoise(*other.camera_);
  }

  struct Summary {
    int iterations = 0;
    double first_cost = 0.0, last_cost = 0.0;
    bool failed = false;  ///< no step could be solved; the state is as before
  };
  /// Levenberg-Marquardt until the calibration moves less than a hundredth of its sigma, or `max_iterations`.
  Summary optimize(int max_iterations);

  /// 14x14 covariance in the order of CalibrationEstimate, at the current state; false if it cannot be computed.
  bool calibrationCovariance(Matrix14d* covariance);

  /// Turns everything before `stamp` into a prior on what remains.
  bool marginalizeBefore(TimeNs stamp);

  /// Replaces the shared start values: the joint calibration fed back (never as information).
  void setLinearization(const Calibration& calibration) {
    state_.calibration = calibration;
    solved_.reset();
  }

 private:
  struct Prior {  // 1/2 d^T H d + b^T d with d = state minus base
    std::vector<int> nodes;
    WindowState base;
    Eigen::MatrixXd H;
    Eigen::VectorXd b;
  };
  void build(const WindowState& state, int end_node, ChainSystem* system);
  void addPriors(const WindowState& state, ChainSystem* system) const;
  void addMarginalPrior(const WindowState& state, ChainSystem* system) const;
  void startBoard();

  Params params_;
  ImuBuffer imu_;
  WindowState state_, origin_;  // origin: where the priors are centred
  InertialChain chain_;
  std::optional<CameraGroup> camera_;
  std::optional<LidarGroup> lidar_;
  PlaneMap plane_map_;
  std::optional<Prior> prior_;
  std::optional<ChainSystem> solved_;  // of the last optimize(), while nothing has changed since
  bool board_known_ = false;
  int linked_scans_ = 0;
};

}  // namespace cocalib
