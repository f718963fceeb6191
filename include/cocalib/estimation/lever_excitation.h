#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/window_state.h"

namespace cocalib {

/// What of the lever arms the motion has not shown.
struct UnseenLevers {
  Eigen::Matrix3Xd directions;  ///< orthonormal, in the IMU frame, as columns: the rig has not turned them
  bool scale = false;           ///< the IMU has not moved, so that a camera without a board cannot tell near from far
};

/// Follows which directions of the lever arms the motion shows.
///
/// A sensor's path p + R t contains its lever arm t only as far as R t changes: along u nothing shows while R u stands
/// still. But the estimated R u never stands quite still, and least squares take its noise for motion: information
/// about u that is not there grows without end, and so does the error. So the directions along which the rig has not
/// turned, and whether it has been shifted, are told by the IMU's own readings, and a system is made blind to the rest.
class LeverExcitation {
 public:
  /// Remembers what `nodes` show before the first `dropped` of them leave the window.
  /// @param chain  the inertial segments between them
  void remember(const std::vector<NavState>& nodes, const InertialChain& chain, int dropped);

  /// What neither the past nor `nodes` show.
  UnseenLevers unseen(const std::vector<NavState>& nodes, const InertialChain& chain) const;

 private:
  Eigen::Matrix3d past_turning_ = Eigen::Matrix3d::Zero();  ///< credited [rad^2 s]
  double past_shifting_ = 0.0;                              ///< credited [m^2 s]
};

/// How the lever arms of a window hang together.
struct LeverLinks {
  bool camera = false, lidar = false;  ///< take part
  bool camera_board = false;           ///< the camera has seen the board, whose size is known
  bool lidar_board = false;            ///< the lidar measures it too: what one lever arm does, the other must do
};

/// Takes out of the normal equations what they seem to know along what is unseen. With c = R u, a shift of a lever arm
/// by u together with one of the planes and the board by c changes no measurement; nor does a longer lever arm together
/// with a larger scene, for a camera that only turns. What is left is to be held by priors, which are to be added
/// afterwards.
void blind(const UnseenLevers& unseen, const LeverLinks& links, const WindowState& state, ChainSystem* system);

}  // namespace cocalib
