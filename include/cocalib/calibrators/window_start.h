#pragma once

#include "cocalib/estimation/inertial_window.h"
#include "cocalib/initialization/alignment.h"

namespace cocalib {

/// Starts a window at the first state of an alignment and lays evenly spaced nodes up to its last one, each
/// propagated from the alignment's state before it. What the motion leaves open is held as the alignment held it.
void startNodes(const Alignment& alignment, const Calibration& calibration, InertialWindow* window);

}  // namespace cocalib
