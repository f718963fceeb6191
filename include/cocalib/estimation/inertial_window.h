#pragma once

#include <optional>

#include "cocalib/estimation/calibration_prior.h"
#include "cocalib/estimation/camera_group.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/imu_noise_scale.h"
#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/lever_excitation.h"
#include "cocalib/estimation/lidar_group.h"
#include "cocalib/estimation/marginal_prior.h"
#include "cocalib/estimation/window_state.h"

namespace cocalib {

/// What InertialWindow::relink() associates.
enum class Relink {
  kNewScans,   ///< what has come since the last time
  kAllScans,   ///< every point anew, with the planes there are
  kNewPlanes,  ///< every point anew, with planes found in all scans of the window
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

  /// 1 sigma of the sensors' positions about the start [m], from the next reset() on; params' own until then.
  void setTranslationPriors(double camera_m, double lidar_m) {
    params_.priors.camera_translation_m = camera_m;
    params_.priors.lidar_translation_m = lidar_m;
  }

  /// Earlier data's calibration in place of WindowPriors' extrinsics and clock offsets, from the next reset() on;
  /// nothing: those again. It counts as information: of data that the window does not see itself.
  void setCalibrationPrior(const std::optional<CalibrationPrior>& prior);

  /// Starts over with a first node and a start for everything shared. The node fixes position and heading.
  void reset(const NavState& first, const Calibration& calibration, double gravity);

  ImuBuffer& imu() { return imu_; }
  const ImuBuffer& imu() const { return imu_; }
  const WindowState& state() const { return state_; }
  const CameraGroup* camera() const { return camera_ ? &*camera_ : nullptr; }
  const LidarGroup* lidar() const { return lidar_ ? &*lidar_ : nullptr; }
  const InertialChain& chain() const { return chain_; }
  const PlaneMap& planeMap() const { return plane_map_; }
  /// Planes that points in the window lie on.
  std::size_t planesInUse() const;
  bool boardKnown() const { return board_known_; }
  /// The camera's lever arm is known up to its length only: no board, and the IMU has not been shifted.
  bool cameraScaleUnseen() const { return camera_ && !board_known_ && excitation_.unseen(state_.nodes, chain_).scale; }

  /// Appends a node; one closer than a third of the node spacing to the last, or before it, is left out.
  void addNode(const NavState& state);
  /// Appends nodes up to `stamp`, spaced evenly, propagated from the last one.
  void extendTo(TimeNs stamp);
  void addFrame(const VisualKeyframe& keyframe) { camera_->addFrame(keyframe); }
  void addScan(std::shared_ptr<const LidarScan> scan) {
    lidar_->addScan(std::move(scan));
    ++scans_since_planes_;
  }

  /// Makes the inertial segments of new nodes, so that poses can be asked for; relink() does it too.
  void updateChain() { chain_.update(state_.nodes, imu_); }
  /// What the scans since the last relink() call for: new planes where there are none yet, where those there are were
  /// found in scans that have all left the window, or where the newest scans find fewer points on them.
  Relink neededRelink() const;
  /// Associates: inertial segments, frames and landmarks, planes and lidar points.
  ///
  /// Planes are landmarks. Before anything was marginalized all of them are found anew; after it, those seen before
  /// keep their number and estimate, those that nothing in the window lies on any more are eliminated (what they said
  /// about the rest stays in the prior), and new ones join. So the rig may leave the room, and memory stays bounded.
  /// @param slack_m  uncertainty of the current poses, for the gates
  /// @param points   of each scan, see LidarGroup::link()
  void relink(Relink what, double slack_m, std::size_t points = LidarGroup::kLivePoints);

  /// Sets the noise of corners, tracks, ranges and the IMU to what their residuals show; call it after optimize() and
  /// before marginalizing. The IMU's is never less than params say.
  void learnNoise();
  const ImuNoiseScale& imuNoiseScale() const { return imu_scale_; }

  /// Starts from what another window of the same data has found out: the noise of the IMU, of corners and tracks, and
  /// where the board stands in the sweeps.
  void adopt(const InertialWindow& other) {
    scaleImuNoise(other.imu_scale_);
    if (camera_ && other.camera_) camera_->adoptNoise(*other.camera_);
    if (lidar_ && other.lidar_) lidar_->adoptBoards(*other.lidar_);
  }

  struct Summary {
    int iterations = 0;
    double first_cost = 0.0, last_cost = 0.0;
    bool failed = false;  ///< no step could be solved, or none made it better; the state is as before
  };
  /// Levenberg-Marquardt until the calibration moves less than a hundredth of its sigma, or `max_iterations`.
  Summary optimize(int max_iterations);

  /// 14x14 covariance in the order of CalibrationEstimate, at the current state; false if it cannot be computed.
  bool calibrationCovariance(Matrix14d* covariance);

  /// Turns everything before `stamp` into a prior on what remains.
  bool marginalizeBefore(TimeNs stamp);

  /// Replaces the shared start values: the joint calibration fed back (never as information). Along directions that the
  /// motion does not show a lever arm stays where it is: nothing would hold it at another value, nor bring it back.
  void setLinearization(const Calibration& calibration);

 private:
  void build(const WindowState& state, int end_node, ChainSystem* system);
  bool take(const ChainSystem::Step& step, double most, ChainSystem* next);
  void addGlobalPriors(const WindowState& state, ChainSystem* system) const;
  void holdAccelBias(const WindowState& state, ChainSystem* system) const;
  static void holdUnmeasuredWay(ChainSystem* system);
  void addFirstPrior(const WindowState& state, ChainSystem* system) const;
  void addCalibrationPrior(const WindowState& state, ChainSystem* system) const;
  void learnImuNoise();
  void scaleImuNoise(const ImuNoiseScale& scale);
  void startBoard();
  void rebuildPlanes();
  std::vector<std::optional<Plane>> retirePlanes();

  Params params_;
  ImuBuffer imu_;
  WindowState state_, origin_;  // origin: where the priors are centred
  InertialChain chain_;
  std::optional<CameraGroup> camera_;
  std::optional<LidarGroup> lidar_;
  PlaneMap plane_map_;
  std::optional<MarginalPrior> prior_;
  std::optional<ChainSystem> solved_;  // of the last optimize(), while nothing has changed since
  LeverExcitation excitation_;
  std::optional<CalibrationPrior> calibration_prior_;
  Matrix14d prior_information_ = Matrix14d::Zero();  // of calibration_prior_
  ImuNoiseScale imu_scale_;                          // of params' noise, in use
  TimeNs imu_learnt_until_ = 0;                      // newest node when it was last measured
  bool board_known_ = false;
  int linked_scans_ = 0;
  int scans_since_planes_ = 0;
  double share_on_planes_ = 0.0;  // of the points, when the planes were found
};

}  // namespace cocalib
