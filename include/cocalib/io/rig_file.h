#pragma once

#include <string>

#include "cocalib/io/rig_config.h"

namespace cocalib {

/// Reads and validates a rig file (YAML; keys in README and cfg/rigs/).
/// @throws std::runtime_error with one line naming file, key, what is wrong and the allowed range
RigConfig loadRigFile(const std::string& path);

/// Same, from text; `path` is used in messages only.
RigConfig parseRig(const std::string& yaml, const std::string& path);

}  // namespace cocalib
