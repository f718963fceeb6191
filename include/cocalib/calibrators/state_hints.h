#pragma once

#include <deque>
#include <optional>

#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Where a calibrator believed the IMU to be, in its own world: a start for the nodes of another window, never
/// information.
class StateHints {
 public:
  /// States that are not newer than the last are passed over.
  void add(const std::optional<NavState>& state);
  bool empty() const { return states_.empty(); }
  const std::deque<NavState>& states() const { return states_; }

  /// The state at `stamp`: the newest hint before it, carried on by the IMU. Where there are no samples, the hint
  /// itself with its own stamp.
  NavState at(TimeNs stamp, const ImuBuffer& imu, double gravity) const;

  /// Keeps the last one at or before `stamp`, and all after it.
  void forgetBefore(TimeNs stamp);
  void clear() { states_.clear(); }

 private:
  std::deque<NavState> states_;
};

/// Both worlds are gravity-aligned and so differ by a turn about the vertical and a shift: T_A_B from one state in
/// both.
Pose alignWorlds(const NavState& in_a, const NavState& in_b);

}  // namespace cocalib
