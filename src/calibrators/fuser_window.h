#pragma once

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/estimation/inertial_window.h"

namespace cocalib {

/// The window of a fuser with these sensors.
InertialWindow::Params fuserWindowParams(const FuserParams& params, const ImuNoise& noise, const FuserInputs& inputs);

/// What the fuser knows, as a prior for a window that begins anew; nothing while it knows nothing.
std::optional<CalibrationPrior> knowledge(const CalibrationEstimate& estimate);

}  // namespace cocalib
