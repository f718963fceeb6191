#include "cocalib/factors/imu_factor.h"

#include <gtest/gtest.h>

#include "numeric_jacobian.h"

namespace cocalib {
namespace {

Preintegration someSegment() {
  std::vector<ImuSample> samples;
  for (int i = 0; i < 21; ++i) {
    const double t = i * 0.0025;
    samples.push_back({toNs(t), {1.0 + t, -0.5 * t, 0.8 - 2.0 * t}, {0.3, 9.5 + 3.0 * t, 1.0 - 4.0 * t}});
  }
  return Preintegration(std::move(samples), ImuNoise(), {0.01, 0.0, -0.01}, {0.1, 0.0, 0.0});
}

NavState startState() {
  NavState state;
  state.T_W_I = {expSo3({0.4, -1.1, 0.7}), {3.0, -2.0, 0.5}};
  state.v_W = {0.5, -1.0, 0.25};
  state.gyro_bias = {0.012, -0.001, -0.008};
  state.accel_bias = {0.11, 0.02, -0.03};
  return state;
}

TEST(ImuFactor, IsZeroWhereTheSegmentLeads) {
  const Preintegration segment = someSegment();
  const NavState end = propagate(segment, startState(), 9.81, segment.end());
  const ImuFactor factor(segment, ImuNoise());
  // Whitening divides by sigmas near 1e-6: 1e-3 here is a nanometre.
  EXPECT_LT(factor.evaluate(startState(), end, 9.81).r.norm(), 1e-3);
}

TEST(ImuFactor, CountsBiasChangeInSigmas) {
  const Preintegration segment = someSegment();
  const ImuNoise noise;
  const NavState start = startState();
  NavState end = propagate(segment, start, 9.81, segment.end());
  // Over 0.05 s the walk's sigma is density * sqrt(0.05): two of them are a residual of 2.
  end.gyro_bias.y() += 2.0 * noise.gyro_bias_walk * std::sqrt(0.05);
  EXPECT_NEAR(ImuFactor(segment, noise).evaluate(start, end, 9.81).r[10], 2.0, 1e-6);
}

TEST(ImuFactor, JacobiansMatchCentralDifferences) {
  const Preintegration segment = someSegment();
  const ImuFactor factor(segment, ImuNoise());
  const NavState i = startState();
  Vector15d off;
  off << 0.01, -0.02, 0.03, 0.05, -0.04, 0.02, 0.1, 0.2, -0.1, 1e-3, 2e-3, -1e-3, 0.01, 0.02, 0.03;
  const NavState j = plus(propagate(segment, i, 9.81, segment.end()), off);
  const auto move = [](const NavState& s, const Vector15d& d) { return plus(s, d); };
  const ImuResidual f = factor.evaluate(i, j, 9.81);
  const Matrix15d over_i =
      test::numericJacobian<15, 15>(i, move, [&](const NavState& s) { return factor.evaluate(s, j, 9.81).r; });
  const Matrix15d over_j =
      test::numericJacobian<15, 15>(j, move, [&](const NavState& s) { return factor.evaluate(i, s, 9.81).r; });
  EXPECT_TRUE(f.J_i.isApprox(over_i, 1e-6)) << (f.J_i - over_i).cwiseAbs().maxCoeff();
  EXPECT_TRUE(f.J_j.isApprox(over_j, 1e-6)) << (f.J_j - over_j).cwiseAbs().maxCoeff();
  const Vector15d over_gravity = (factor.evaluate(i, j, 9.81 + 1e-4).r - factor.evaluate(i, j, 9.81 - 1e-4).r) / 2e-4;
  EXPECT_LT((f.J_gravity - over_gravity).norm(), 1e-6 * over_gravity.norm());
}

}  // namespace
}  // namespace cocalib
