#include "cocalib/ros/plane_patches.h"

#include <gtest/gtest.h>

namespace cocalib {
namespace {

/// Two walls and a few points of neither: number 3 is x = 2 over 4 m by 2 m, number 7 is z = -1 and has few points.
DeskewedCloud twoWalls() {
  DeskewedCloud cloud;
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

TEST(PlanePatches, FollowThePoints) {
  const std::vector<PlanePatch> patches = fitPatches(twoWalls());
  ASSERT_EQ(patches.size(), 1U);  // twenty points are too few
  const PlanePatch& wall = patches.front();
  EXPECT_EQ(wall.number, 3);
  EXPECT_NEAR(std::abs(wall.plane_W.normal.x()), 1.0, 1e-9);
  EXPECT_NEAR(wall.length_m, 4.0, 1e-5);
  EXPECT_NEAR(wall.width_m, 2.0, 1e-5);
  EXPECT_LT((wall.T_W_P.t - Eigen::Vector3d(2.0, 0.0, 1.0)).norm(), 1e-5);
  EXPECT_NEAR(std::abs((wall.T_W_P.q * Eigen::Vector3d::UnitZ()).x()), 1.0, 1e-9);
}

TEST(PlanePatches, GiveDistances) {
  DeskewedCloud cloud = twoWalls();
  const std::vector<PlanePatch> patches = fitPatches(cloud);
  cloud.points_W[0].x() += 0.05F;
  const std::vector<float> distances = distancesToPatches(cloud, patches);
  ASSERT_EQ(distances.size(), cloud.points_W.size());
  EXPECT_NEAR(distances[0], 0.05F, 1e-5);
  EXPECT_NEAR(distances[1], 0.0F, 1e-5);
  EXPECT_EQ(distances[cloud.points_W.size() - 2], -1.0F);  // of no plane
  const visualization_msgs::MarkerArray markers = toPatchMarkers(patches, 5, "world");
  ASSERT_EQ(markers.markers.size(), 1U);
  EXPECT_EQ(markers.markers[0].id, 3);
  EXPECT_NEAR(markers.markers[0].scale.x, 4.0, 1e-5);
}

}  // namespace
}  // namespace cocalib
