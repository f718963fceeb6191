#pragma once

#include "cocalib/estimation/inertial_window.h"
#include "cocalib/initialization/alignment.h"

namespace cocalib {

/// Gives the lever arm back to its prior along directions that the motion does not show: noise alone has moved it
/// there. The sensor stays where it was in the world, the IMU moves.
void returnUnseenToPrior(const ImuBuffer& imu, Alignment* alignment);

/// Starts a window at the first state of an alignment and lays evenly spaced nodes up to its last one, each
/// propagated from the alignment's state before it. What the motion leaves open is held as the alignment held it.
void startNodes(const Alignment& alignment, const Calibration& calibration, InertialWindow* window);

}  // namespace cocalib
