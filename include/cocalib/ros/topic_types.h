#pragma once

#include <vector>

#include "cocalib/io/rig_config.h"
#include "cocalib/monitor/input_doctor.h"

namespace cocalib {

/// Asks the master for the rig's topics on which messages of another type are published than a sensor's; nothing of
/// them ever comes.
/// @return a finding each, of the check that otherwise only says that nothing comes
std::vector<Finding> findWrongTypes(const RigConfig& rig);

}  // namespace cocalib
