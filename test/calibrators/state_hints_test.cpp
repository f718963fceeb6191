#include "cocalib/calibrators/state_hints.h"

#include <gtest/gtest.h>

#include "cocalib/sim/imu.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// The same state in a world that is turned about the vertical and shifted.
NavState inWorld(const Pose& T_A_W, NavState state) {
  state.T_W_I = T_A_W * state.T_W_I;
  state.v_W = T_A_W.q * state.v_W;
  return state;
}

Pose worldOf(double yaw_rad, const Eigen::Vector3d& shift_m) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ())), shift_m};
}

TEST(HintedNodes, GoOnWhereACalibratorHasStartedAnew) {
  sim::Scenario s;
  s.duration_s = 9.0;
  const sim::Trajectory trajectory(s);
  InertialWindow window{InertialWindow::Params()};
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) window.imu().push(sample);
  StateHints hints;
  // From 4 s on the hints are in another world, after two seconds without any.
  const Pose first = worldOf(0.7, {3.0, -1.0, 0.2}), second = worldOf(-2.0, {-5.0, 4.0, 0.0});
  for (double t = 1.0; t < 8.0; t += 0.1) {
    if (t > 2.0 && t < 4.0) continue;
    hints.add(inWorld(t < 3.0 ? first : second, trajectory.stateAt(trajectory.stampOf(t))));
  }
  window.reset(trajectory.stateAt(trajectory.stampOf(1.0)), Calibration(), s.gravity);
  for (double t = 1.1; t < 8.0; t += 0.1) HintedNodes(hints, &window).fillTo(trajectory.stampOf(t));

  ASSERT_GT(window.state().nodes.size(), 120U);
  for (const NavState& node : window.state().nodes) {
    const NavState truth = trajectory.stateAt(node.stamp);
    // Two seconds of the inertial sensors alone: centimetres.
    EXPECT_LT((node.T_W_I.t - truth.T_W_I.t).norm(), 0.05) << trajectory.timeOf(node.stamp);
    EXPECT_LT((node.v_W - truth.v_W).norm(), 0.05) << trajectory.timeOf(node.stamp);
    EXPECT_LT(node.T_W_I.q.angularDistance(truth.T_W_I.q), 0.01) << trajectory.timeOf(node.stamp);
  }
}

}  // namespace
}  // namespace cocalib
