#pragma once

#include <string>

#include "cocalib/estimation/estimate.h"

namespace cocalib::bench {

/// One line about the estimates on the way to a result: how many, since when each sensor is within 1 deg and 5 cm of
/// the truth and since when all is called converged, and how many have an error above three of their stated sigmas in
/// any of the parameters.
/// @param result_dir  where calibrate_bag wrote its `convergence.csv`
/// @throws std::runtime_error naming the file
std::string liveLine(const std::string& result_dir, const Calibration& truth);

}  // namespace cocalib::bench
