#include "cocalib/factors/point_factors.h"

#include <gtest/gtest.h>

#include <random>

#include "cocalib/factors/robust.h"
#include "numeric_jacobian.h"

namespace cocalib {
namespace {

using Scalar = Eigen::Matrix<double, 1, 1>;

// Far from identity, so that a swapped frame or a missing rotation cannot cancel out.
const Pose kT_W_S{expSo3({0.4, -1.1, 2.3}), {3.0, -2.0, 0.5}};
const CameraModel kCamera(CameraModel::Distortion::kRadTan, {460.0, 455.0, 375.0, 240.0}, {-0.2, 0.05, 1e-3, -5e-4},
                          752, 480);

TEST(Reprojection, IsZeroAtTheProjectionAndCountsPixelsInSigmas) {
  const Eigen::Vector3d p_W = kT_W_S * Eigen::Vector3d(0.3, -0.2, 2.5);
  const Eigen::Vector2d px = *kCamera.project({0.3, -0.2, 2.5});
  EXPECT_LT(reprojection(kT_W_S, p_W, px, 0.5, kCamera)->r.norm(), 1e-9);
  EXPECT_NEAR(reprojection(kT_W_S, p_W, px - Eigen::Vector2d(1.0, 0.0), 0.5, kCamera)->r.x(), 2.0, 1e-9);
}

TEST(Reprojection, JacobiansMatchCentralDifferences) {
  const Eigen::Vector3d p_W = kT_W_S * Eigen::Vector3d(0.5, -0.4, 2.0);
  const auto f = reprojection(kT_W_S, p_W, {300.0, 200.0}, 0.7, kCamera);
  ASSERT_TRUE(f);
  const auto over_pose = [&](const Pose& T) { return reprojection(T, p_W, {300.0, 200.0}, 0.7, kCamera)->r; };
  EXPECT_TRUE(f->J_pose.isApprox(test::numericPoseJacobian<2>(kT_W_S, over_pose), 1e-6));
  const auto over_point = [&](const Eigen::Vector3d& p) {
    return reprojection(kT_W_S, p, {300.0, 200.0}, 0.7, kCamera)->r;
  };
  const auto add = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) -> Eigen::Vector3d { return a + b; };
  EXPECT_TRUE(f->J_point.isApprox((test::numericJacobian<2, 3>(p_W, add, over_point)), 1e-6));
}

TEST(Reprojection, GivesNothingBehindTheCamera) {
  EXPECT_FALSE(reprojection(kT_W_S, kT_W_S * Eigen::Vector3d(0.1, 0.1, -1.0), {0.0, 0.0}, 1.0, kCamera));
}

TEST(PointJacobian, MatchesCentralDifferences) {
  const Eigen::Vector3d p_B(0.3, 0.2, 0.0);
  const auto point = [&](const Pose& T) -> Eigen::Vector3d { return T * p_B; };
  EXPECT_TRUE(pointJacobian(kT_W_S, p_B).isApprox(test::numericPoseJacobian<3>(kT_W_S, point), 1e-7));
}

struct Cloud {
  std::vector<Eigen::Vector3d> points_L;
  PlanePoints sum;
};

Cloud someCloud(double weight) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> coordinate(-5.0, 5.0);
  Cloud cloud;
  for (int i = 0; i < 50; ++i) {
    cloud.points_L.emplace_back(coordinate(random), coordinate(random), coordinate(random));
    Eigen::Vector4d h;
    h << cloud.points_L.back(), 1.0;
    cloud.sum.moment += weight * h * h.transpose();
  }
  return cloud;
}

const Plane kPlane{Eigen::Vector3d(1.0, -2.0, 0.5).normalized(), 1.5, {3.0, 0.5, -1.0}};

TEST(PlaneMoment, EqualsTheSumOverItsPoints) {
  const Cloud cloud = someCloud(4.0);
  double half_sum = 0.0;
  for (const auto& p : cloud.points_L) half_sum += 0.5 * 4.0 * std::pow(kPlane.distance(kT_W_S * p), 2);
  EXPECT_NEAR(planeMoment(kT_W_S, kPlane, cloud.sum).cost, half_sum, 1e-8 * half_sum);
}

TEST(PlaneMoment, GradientAndHessianEqualThoseOfItsPoints) {
  const Cloud cloud = someCloud(1.0);
  const PlaneMomentResidual f = planeMoment(kT_W_S, kPlane, cloud.sum);
  const auto distances = [&](const Pose& T) {
    Eigen::Matrix<double, 50, 1> r;
    for (int i = 0; i < 50; ++i) r[i] = kPlane.distance(T * cloud.points_L[static_cast<std::size_t>(i)]);
    return r;
  };
  const auto J = test::numericPoseJacobian<50>(kT_W_S, distances);
  EXPECT_TRUE(f.H_pose.isApprox(J.transpose() * J, 1e-6));
  EXPECT_TRUE(f.b_pose.isApprox(J.transpose() * distances(kT_W_S), 1e-6));
}

TEST(PlaneMoment, NoiseAlongTheRaysLeavesTheGradientButNotTheHessian) {
  // A point's part is quadratic in the error of its range: all errors one sigma long and all one sigma short have
  // together the mean of all that may happen.
  const Cloud cloud = someCloud(1.0);
  const PlaneMomentResidual want = planeMoment(kT_W_S, kPlane, cloud.sum);
  constexpr double kSigma = 0.2;
  Vector6d mean = Vector6d::Zero(), uncorrected = Vector6d::Zero();
  for (const double error : {-kSigma, kSigma}) {
    PlanePoints noisy;
    for (const Eigen::Vector3d& p : cloud.points_L) {
      const Eigen::Vector3d ray = p.normalized();
      const Eigen::Vector4d h = (p + error * ray).eval().homogeneous();
      noisy.moment += h * h.transpose();
      noisy.noise += kSigma * kSigma * ray * ray.transpose();
    }
    const PlaneMomentResidual f = planeMoment(kT_W_S, kPlane, noisy);
    mean += 0.5 * f.b_pose;
    noisy.noise.setZero();
    const PlaneMomentResidual plain = planeMoment(kT_W_S, kPlane, noisy);
    EXPECT_EQ(plain.H_pose, f.H_pose);
    uncorrected += 0.5 * plain.b_pose;
  }
  EXPECT_LT((mean - want.b_pose).norm(), 1e-9 * want.b_pose.norm());
  EXPECT_GT((uncorrected - want.b_pose).norm(), 1e-4);
}

TEST(PlaneMoment, PlaneTangentsMatchCentralDifferences) {
  const auto coefficients = [](const Plane& plane) {
    Eigen::Vector4d c;
    c << plane.normal, plane.offset_m;
    return c;
  };
  const auto move = [](const Plane& plane, const Eigen::Vector3d& d) { return plus(plane, d); };
  EXPECT_TRUE(planeTangent(kPlane).isApprox(test::numericJacobian<4, 3>(kPlane, move, coefficients), 1e-7));
  const auto board = [&](const Pose& T) { return coefficients(boardPlane(T)); };
  EXPECT_TRUE(boardPlaneTangent(kT_W_S).isApprox(test::numericPoseJacobian<4>(kT_W_S, board), 1e-7));
}

TEST(BoardEdge, IsTheDistanceFromTheEdgeInSigmas) {
  // Lidar 2 m before the board's origin, looking along z_B; the beam meets the board at x = 0.2.
  const Pose T_W_B = kT_W_S;
  const Pose T_W_L = T_W_B * Pose{Eigen::Quaterniond::Identity(), {0.0, 0.0, -2.0}};
  const auto f = boardEdge(T_W_L, T_W_B, Eigen::Vector3d(0.2, 0.0, 2.0).normalized(), 0, 0.19, 0.005);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->r, 2.0, 1e-9);
}

TEST(BoardEdge, JacobiansMatchCentralDifferences) {
  const Pose T_W_B = kT_W_S;
  const Pose T_W_L = T_W_B * Pose{expSo3({0.1, -0.2, 0.3}), {0.3, -0.1, -2.5}};
  const Eigen::Vector3d bearing = Eigen::Vector3d(0.1, 0.2, 1.0).normalized();
  for (const int axis : {0, 1}) {
    const auto f = boardEdge(T_W_L, T_W_B, bearing, axis, 0.4, 0.01);
    ASSERT_TRUE(f);
    const auto over_lidar = [&](const Pose& T) { return Scalar(boardEdge(T, T_W_B, bearing, axis, 0.4, 0.01)->r); };
    const auto over_board = [&](const Pose& T) { return Scalar(boardEdge(T_W_L, T, bearing, axis, 0.4, 0.01)->r); };
    EXPECT_TRUE(f->J_pose.isApprox(test::numericPoseJacobian<1>(T_W_L, over_lidar), 1e-6));
    EXPECT_TRUE(f->J_board.isApprox(test::numericPoseJacobian<1>(T_W_B, over_board), 1e-6));
    EXPECT_NEAR(f->J_edge, -100.0, 1e-9);
  }
}

TEST(BoardEdge, GivesNothingAlongTheBoard) {
  EXPECT_FALSE(boardEdge(kT_W_S, kT_W_S, Eigen::Vector3d::UnitX(), 0, 0.0, 0.01));
}

TEST(Huber, IsQuadraticNearAndLinearFar) {
  EXPECT_DOUBLE_EQ(huber(1.0, 2.0).weight, 1.0);
  EXPECT_DOUBLE_EQ(huber(1.0, 2.0).cost, 0.5);
  EXPECT_DOUBLE_EQ(huber(16.0, 2.0).weight, 0.5);
  EXPECT_DOUBLE_EQ(huber(16.0, 2.0).cost, 6.0);
}

}  // namespace
}  // namespace cocalib
