#pragma once

#include <string>

#include "cocalib/calibrators/diagnostics.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/inertial_window.h"

namespace cocalib {

/// Counts the solves that failed in a row. One that fails leaves the last good state and may be followed by a good one;
/// three in a row say that states and data have parted, and that only a new start helps.
class FailedSolves {
 public:
  /// @return whether to start over
  bool note(bool good, CalibratorDiagnostics* diagnostics) {
    in_row_ = good ? 0 : in_row_ + 1;
    if (!good) ++diagnostics->counts["failed solves"];
    return in_row_ >= kMaxInRow;
  }
  void reset() { in_row_ = 0; }

 private:
  static constexpr int kMaxInRow = 3;
  int in_row_ = 0;
};

/// Whether the newest state and the calibration are such as a rig can have; a solve that diverges leaves others.
bool isPossible(const WindowState& state);

/// Whether the states are possible and explain what cameras and lidars saw, as the last relink() found it.
bool explainsData(const InertialWindow& window);

/// Says that inertial data were missing between a window's newest state and `until` for so long that the motion is
/// unknown; empty if they were not.
std::string imuGap(const InertialWindow& window, TimeNs until);

/// Why a window cannot go on from its newest state to `until`, in words; empty if it can: an imuGap(), or a sensor that
/// was silent for so long that its states would rest on the IMU alone.
/// @param longest_s  that the sensor may be silent
/// @param what       it delivers, e.g. "pictures"
std::string interruption(const InertialWindow& window, TimeNs until, double longest_s, const std::string& what);

/// Forgets inertial data that no start can use: older than the data of the sensor, or before an imuGap().
/// @param oldest, newest  times of the data that wait for the start; what comes after a later gap is still to be used
/// @return from when on data of the sensor can be used; those from before have no inertial data to start from
TimeNs forgetUselessImu(TimeNs oldest, TimeNs newest, ImuBuffer* imu);

/// Counts a new start and says why; the estimate is forgotten.
void sayStartingOver(const std::string& reason, CalibrationEstimate* estimate, CalibratorDiagnostics* diagnostics);

}  // namespace cocalib
