#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/repeat_weight.h"
#include "cocalib/estimation/track_noise.h"
#include "cocalib/factors/timed_sensor_pose.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// The visual factors of a window: chessboard corners against the board landmark, and natural features, whose landmarks
/// are eliminated on the camera poses before they enter the system.
///
/// A landmark is X = A + R_A [u v 1]^T / rho about a fixed anchor (A, R_A), the camera's pose when it was made. The
/// anchor is a number, not a state: the parametrisation is good for far points and every observation counts alike.
class CameraGroup {
 public:
  struct Params {
    explicit Params(const CameraModel& model) : camera(model) {}
    CameraModel camera;
    std::optional<BoardGeometry> board;
    double corner_sigma_px = 0.1;
    TrackNoise track_noise;
    /// Tracks differ, by their texture and by how they are seen: each has a scale of its own about the common one,
    /// known as well as from so many residuals.
    double track_freedom = 8.0;
    double gate_sigmas = 5.0;  ///< residual, in sigmas, beyond which a corner counts linearly; tracks: four times that
    /// A longer track goes on as a new landmark: every landmark couples all states between its first and last
    /// observation, and what a tenth observation adds does not pay for that.
    std::size_t max_track_observations = 10;
  };
  explicit CameraGroup(const Params& params) : params_(params) {}

  void addFrame(const VisualKeyframe& keyframe);
  int frames() const { return static_cast<int>(frames_.size()); }
  int boardViews() const;
  bool sawBoard() const { return boardViews() > 0; }

  /// Finds the node of every frame, triangulates new landmarks and drops observations that contradict the state.
  void relink(const WindowState& state, const InertialChain& chain);

  /// Adds all factors; or, with `end_node` >= 0, only those that touch nodes before it.
  void accumulate(const WindowState& state, const InertialChain& chain, int end_node, ChainSystem* system);
  /// Moves the landmarks by the step that solved the last accumulated system; revertLandmarks() takes it back.
  void moveLandmarks(const ChainSystem::Step& step);
  void revertLandmarks();
  /// Takes it back for those landmarks alone that fit worse for it, as the last accumulate() has found: a point whose
  /// views hardly differ may go anywhere, and no damping of the poses holds it. @return whether there are any
  bool revertWorseLandmarks();
  /// Forgets everything that accumulate(.., end_node, ..) used, and renumbers the nodes.
  void dropFront(int end_node);

  /// Replaces the assumed noise of corners and tracks by what the residuals of the last accumulate() of everything
  /// show: noise is measured, not believed. A corner's is bounded below, because errors of the lens model, which are
  /// common to a whole view, do not average out as noise does. @return whether it changed by more than a
  /// twentieth
  bool learnNoise();
  /// Starts from the noise that another group has learnt.
  void adoptNoise(const CameraGroup& other) {
    params_.corner_sigma_px = other.params_.corner_sigma_px;
    params_.track_noise = other.params_.track_noise;
  }

  /// RMS reprojection error of corners and tracks at the last accumulate(), per axis [px].
  double cornerRms() const { return corner_rms_px_; }
  double trackRms() const { return track_rms_px_; }
  /// Share of the track observations that the last relink() found within the gate; 1 where there are none.
  double consistentShare() const { return consistent_share_; }
  /// First frame with a board, with the pose of its camera: a start for the board landmark.
  std::optional<std::pair<TimeNs, BoardObservation>> firstBoardView() const;
  const Params& params() const { return params_; }
  /// Reprojection errors of all corners and tracks in use, both axes in turn [px], at a state and its chain.
  void collectResiduals(const WindowState& state, const InertialChain& chain, std::vector<float>* corners_px,
                        std::vector<float>* tracks_px) const;

 private:
  struct Frame {
    TimeNs stamp = 0;
    int node = -1;
    std::optional<BoardObservation> board;
    std::optional<double> weight;  // see RepeatWeight; set by the first relink()
  };
  struct Observation {
    int frame;
    Eigen::Vector2d px;
    bool used = true;
  };
  struct Landmark {
    Pose T_W_A;
    Eigen::Vector3d uv_rho = Eigen::Vector3d::Zero();
    bool ready = false;
    std::vector<Observation> observations;
    // From the last accumulate(): what back-substitution needs.
    bool eliminated = false;
    Eigen::Matrix3d V_inverse;
    Eigen::Vector3d gradient;
    std::vector<std::pair<int, Eigen::Matrix<double, 6, 3>>> W;  // by frame
    double cost = 0.0;
    // Before the last move.
    Eigen::Vector3d previous;
    double previous_cost = 0.0;
  };
  struct Sums;

  bool touches(const Landmark& landmark, int end_node) const;
  void triangulate(Landmark* landmark, const std::vector<TimedSensorPose>& poses) const;
  void gate(Landmark* landmark, const std::vector<TimedSensorPose>& poses) const;
  std::vector<TimedSensorPose> cameraPoses(const WindowState& state, const InertialChain& chain) const;
  void addBoard(const WindowState& state, int frame, Sums* sums, ChainSystem* system) const;
  /// Residuals and Jacobians of a landmark's observations.
  struct Views;
  bool view(const Landmark& landmark, const std::vector<TimedSensorPose>& poses, Views* views) const;
  /// Applies the noise, which observations share.
  void weigh(Views* views) const;
  void addLandmark(Landmark* landmark, Sums* sums) const;
  /// Mean weight of the frames that saw a landmark.
  double weightOf(const Views& views) const;
  /// Eliminates the landmark whose views `sums` hold, and adds what they then say of the poses.
  bool eliminate(double weight, Landmark* landmark, Sums* sums) const;

  Params params_;
  std::vector<Frame> frames_;
  std::map<std::uint64_t, Landmark> landmarks_;       // ordered, so that sums repeat to the bit
  std::map<std::uint32_t, std::uint64_t> newest_of_;  // newest landmark of each track
  std::uint64_t next_landmark_ = 0;
  RepeatWeight repeats_;
  std::vector<TimedSensorPose> poses_;  // at the last accumulate()
  double corner_rms_px_ = 0.0, track_rms_px_ = 0.0;
  double consistent_share_ = 1.0;
  TrackNoiseEstimator track_residuals_;  // of the last accumulate() of everything
};

}  // namespace cocalib
