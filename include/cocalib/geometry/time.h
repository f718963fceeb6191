#pragma once

#include <cmath>
#include <cstdint>

namespace cocalib {

/// A stamp: nanoseconds on the clock of the sensor it belongs to. Doubles lose 100+ ns today.
using TimeNs = std::int64_t;

/// Duration in seconds -> nanoseconds, rounded. @pre |seconds| < 9e9
inline TimeNs toNs(double seconds) { return static_cast<TimeNs>(std::llround(seconds * 1e9)); }

/// Nanoseconds -> seconds; use it on differences of stamps only.
inline double toSeconds(TimeNs ns) { return static_cast<double>(ns) * 1e-9; }

}  // namespace cocalib
