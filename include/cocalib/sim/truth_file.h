#pragma once

#include <string>

#include "cocalib/sim/scenario.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::sim {

/// What a calibration of the bag should find, as YAML: extrinsics, clock offsets, biases, gravity, the board's pose and
/// the motion at 10 Hz. The keys are those of a calibration file where there is one.
std::string truthText(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory);

/// A rig file for the bag: topics, frames, noise and board, no initial guess.
std::string rigText(const Scenario& scenario);

}  // namespace cocalib::sim
