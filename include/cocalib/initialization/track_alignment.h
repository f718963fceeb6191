#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/chunks.h"
#include "cocalib/initialization/shared_information.h"

namespace cocalib {

/// One sight of a landmark within a chunk.
struct TrackSight {
  std::size_t frame = 0;
  Eigen::Vector3d bearing_C;
};

/// A landmark as one chunk sees it.
struct ChunkTrack {
  std::size_t chunk = 0;
  std::vector<TrackSight> sights;                 ///< by rising time
  Eigen::Vector3d X_G = Eigen::Vector3d::Zero();  ///< relative to the IMU's position at the chunk's start
};

/// Bearings and inertial increments brought together. G is the IMU's orientation at the first frame; orientation comes
/// from the gyro throughout, positions start anew in every chunk.
struct TrackProblem {
  std::vector<Chunk> chunks;
  std::vector<Eigen::Quaterniond> R_G_chunk;
  std::vector<Eigen::Matrix3d> R_G_chunk_bg;  ///< R_G_chunk(bg + d) = R_G_chunk Exp(R_G_chunk_bg d)
  std::vector<std::size_t> chunk_of_frame;    ///< nearest one for frames that the IMU does not cover
  std::vector<InertialIncrement> increments;  ///< of each frame, from its chunk's start
  std::vector<ChunkTrack> tracks;
  Eigen::Quaterniond R_imu_camera = Eigen::Quaterniond::Identity();
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  double time_offset_s = 0.0;

  Eigen::Quaterniond R_G_I(std::size_t frame) const {
    return R_G_chunk[chunk_of_frame[frame]] * increments[frame].R_0_t;
  }
  Eigen::Quaterniond R_G_C(std::size_t frame) const { return R_G_I(frame) * R_imu_camera; }
};

/// @return nothing, and the reason, if the IMU does not cover the frames or too few tracks show parallax
std::optional<TrackProblem> makeTrackProblem(const ImuBuffer& imu, const RotationInitialization& rotation,
                                             const std::vector<BearingFrame>& frames, double chunk_s,
                                             std::string& reason);

/// Solution of a track problem, in G.
struct TrackSolution {
  SharedSolution shared;                    ///< gravity, accelerometer bias, lever arm
  Eigen::Vector3d free_gravity;             ///< when its magnitude is not imposed; linear solution only
  double free_gravity_sigma = 0.0;          ///< of its magnitude [m/s^2]
  std::vector<Eigen::Vector3d> velocities;  ///< at the chunks' starts [m/s]
  double worst_velocity_sigma = 0.0;        ///< [m/s]
  double bearing_sigma_rad = 0.0;           ///< of the bearings' residuals per axis, robust
};

/// Linear least squares with landmarks and velocities eliminated, re-weighted by depth and robustly. Fills the tracks'
/// X_G. Slightly biased by the bearings' noise: a start for refineTracks().
TrackSolution solveTracksLinearly(TrackProblem& problem, const AlignmentParams& params);

/// What refineTracks() changes besides the solution itself.
struct TrackRefinement {
  TrackSolution solution;
  Eigen::Quaterniond R_imu_camera;
  Eigen::Vector3d gyro_bias;
  double time_offset_s = 0.0;
};

/// Maximum likelihood over velocities, gravity's direction, accelerometer and gyro bias, lever arm, mounting rotation,
/// clock offset and landmarks (inverse depth), from the linear solution. Robust (Cauchy). First order in the changes of
/// gyro bias and offset: build the problem anew with the result where they were large.
/// @return nothing if the solver fails
std::optional<TrackRefinement> refineTracks(const TrackProblem& problem, const TrackSolution& start,
                                            const AlignmentParams& params);

constexpr double kStandardGravity = 9.80665;  ///< [m/s^2]

}  // namespace cocalib
