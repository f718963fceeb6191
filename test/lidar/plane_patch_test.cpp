#include "cocalib/lidar/plane_patch.h"

#include <gtest/gtest.h>

#include <limits>

namespace cocalib {
namespace {

/// Two walls and a few points of neither: number 3 is x = 2 over 4 m by 2 m, number 7 is z = -1 and has few points.
struct Sweep {
  std::vector<Eigen::Vector3f> points_W;
  std::vector<std::int16_t> plane;
};
Sweep twoWalls() {
  Sweep cloud;
  const auto add = [&cloud](double x, double y, double z, int plane) {
    cloud.points_W.emplace_back(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
    cloud.plane.push_back(static_cast<std::int16_t>(plane));
  };
  for (int i = 0; i <= 40; ++i) {
    for (int k = 0; k <= 10; ++k) add(2.0, -2.0 + 0.1 * i, 0.2 * k, 3);
  }
  for (int i = 0; i < 20; ++i) add(0.1 * i, 0.0, -1.0, 7);
  add(5.0, 5.0, 5.0, -1);
  add(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0, 3);
  return cloud;
}

TEST(PlanePatch, FollowThePoints) {
  const Sweep cloud = twoWalls();
  const std::vector<PlanePatch> patches = fitPatches(cloud.points_W, cloud.plane);
  ASSERT_EQ(patches.size(), 1U);  // twenty points are too few
  const PlanePatch& wall = patches.front();
  EXPECT_EQ(wall.number, 3);
  EXPECT_NEAR(std::abs(wall.plane_W.normal.x()), 1.0, 1e-9);
  EXPECT_NEAR(wall.length_m, 4.0, 1e-5);
  EXPECT_NEAR(wall.width_m, 2.0, 1e-5);
  EXPECT_LT((wall.T_W_P.t - Eigen::Vector3d(2.0, 0.0, 1.0)).norm(), 1e-5);
  EXPECT_NEAR(std::abs((wall.T_W_P.q * Eigen::Vector3d::UnitZ()).x()), 1.0, 1e-9);
}

TEST(PlanePatch, GiveDistances) {
  Sweep cloud = twoWalls();
  const std::vector<PlanePatch> patches = fitPatches(cloud.points_W, cloud.plane);
  cloud.points_W[0].x() += 0.05F;
  const std::vector<float> distances = distancesToPatches(cloud.points_W, cloud.plane, patches);
  ASSERT_EQ(distances.size(), cloud.points_W.size());
  EXPECT_NEAR(distances[0], 0.05F, 1e-5);
  EXPECT_NEAR(distances[1], 0.0F, 1e-5);
  EXPECT_EQ(distances[cloud.points_W.size() - 2], -1.0F);  // of no plane
}

}  // namespace
}  // namespace cocalib
