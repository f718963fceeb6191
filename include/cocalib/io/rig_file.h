#pragma once

#include <string>

#include "cocalib/io/rig_config.h"

namespace cocalib {

/// Reads and validates a rig file (YAML; keys in README and cfg/rigs/).
/// @throws std::runtime_error with one line naming file, key, what is wrong and the allowed range
RigConfig loadRigFile(const std::string& path);

/// Same, from text; `path` is used in messages only.
RigConfig parseRig(const std::string& yaml, const std::string& path);

/// Takes the result of an earlier run (its calibration.yaml) for initial guess and, with its covariance, for
/// information: short drives add up. @throws std::runtime_error with one line if the file cannot be used
void goOnFrom(const std::string& result_path, RigConfig* rig);

}  // namespace cocalib
