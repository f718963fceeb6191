#pragma once

#include <deque>
#include <optional>

#include "cocalib/estimation/inertial_window.h"
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

/// Appends nodes to a window from hints in another world. Both worlds are gravity-aligned, so they differ by a turn
/// about the vertical and a shift, taken at the window's last node; and taken anew where the hints jump, because the
/// calibrator that gives them has started anew.
class HintedNodes {
 public:
  /// Both must outlive this.
  HintedNodes(const StateHints& hints, InertialWindow* window);

  /// A node at `stamp`, and between it and the last so many that measurements stay near one.
  void fillTo(TimeNs stamp);

 private:
  void addNodeAt(TimeNs stamp);
  /// A node as the inertial data between carry it to `stamp`.
  NavState carriedOn(const NavState& node, TimeNs stamp) const;

  const StateHints& hints_;
  InertialWindow* window_;
  Pose T_window_hint_;
};

}  // namespace cocalib
