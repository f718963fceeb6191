#pragma once

#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/inertial_window.h"

namespace cocalib {

/// What a window's newest state says: stamp, calibration with covariance, biases, gravity. Leaves what judges it alone.
/// @return false, and nothing changed, if the covariance cannot be computed
bool readEstimate(InertialWindow* window, CalibrationEstimate* estimate);

/// Whether data up to `now` are enough for the next of a row of solves. Data come in sweeps and pictures: one a little
/// before its time counts, so that the period is not stretched to the next one.
inline bool isDue(TimeNs now, TimeNs last, double period_s) { return toSeconds(now - last) >= 0.95 * period_s; }

}  // namespace cocalib
