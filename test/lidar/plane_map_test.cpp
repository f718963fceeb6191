#include "cocalib/lidar/plane_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include "cocalib/geometry/pose.h"

namespace cocalib {
namespace {

constexpr double kSigma = 0.03;

PlaneMap::Params exactPoses() {
  PlaneMap::Params params;
  params.point_sigma_m = kSigma;
  params.deskew_sigma_m = 0.0;
  return params;
}

/// Draws points on rectangles with normal noise.
class Sampler {
 public:
  explicit Sampler(const Pose& T_W_S = Pose()) : T_W_S_(T_W_S) {}

  /// Points on corner + a u + b v, 0 <= a, b <= 1, with noise along the normal.
  std::vector<Eigen::Vector3d> patch(const Eigen::Vector3d& corner, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
                                     int count) {
    std::uniform_real_distribution<double> even(0.0, 1.0);
    std::normal_distribution<double> noise(0.0, kSigma);
    const Eigen::Vector3d normal = u.cross(v).normalized();
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < count; ++i) {
      const double a = even(random_), b = even(random_);
      points.push_back(T_W_S_ * (corner + a * u + b * v + noise(random_) * normal));
    }
    return points;
  }

 private:
  Pose T_W_S_;
  std::mt19937_64 random_{7};
};

void add(const std::vector<Eigen::Vector3d>& points, PlaneMap* map) {
  for (const Eigen::Vector3d& p : points) map->addPoint(p);
}

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) { return std::asin(a.cross(b).norm()); }

/// Three walls of a room of 6 x 5 x 3 m that meet in the corner (0, 0, 0), seen under the transform T_W_S.
struct Corner {
  explicit Corner(const Pose& T_W_S_in) : T_W_S(T_W_S_in), map(exactPoses()) {
    Sampler sampler(T_W_S);
    const Eigen::Vector3d x = 6.0 * Eigen::Vector3d::UnitX(), y = 5.0 * Eigen::Vector3d::UnitY(),
                          z = 3.0 * Eigen::Vector3d::UnitZ(), origin = Eigen::Vector3d::Zero();
    walls = {sampler.patch(origin, x, y, 200000), sampler.patch(origin, x, z, 150000),
             sampler.patch(origin, y, z, 120000)};
    normals = {T_W_S.q * Eigen::Vector3d::UnitZ(), T_W_S.q * Eigen::Vector3d::UnitY(),
               T_W_S.q * Eigen::Vector3d::UnitX()};
    for (const auto& wall : walls) add(wall, &map);
    map.extract();
  }

  Pose T_W_S;
  PlaneMap map;
  std::vector<std::vector<Eigen::Vector3d>> walls;
  std::vector<Eigen::Vector3d> normals;
};

// Walls in the middle of voxels, on their faces and a little beside them, and turned in every way.
const std::vector<Pose> kPlacements = {
    {Eigen::Quaterniond::Identity(), {0.2, 0.2, 0.2}},     {Eigen::Quaterniond::Identity(), {0.0, 0.4, 1.2}},
    {Eigen::Quaterniond::Identity(), {0.38, -0.03, 0.05}}, {expSo3({0.02, -0.03, 0.4}), {1.0, 2.0, -3.0}},
    {expSo3({0.5, -0.6, 0.7}), {-2.0, 0.3, 0.7}},
};

TEST(PlaneMap, FindsWallsToAFractionOfAMillimetre) {
  for (std::size_t placement = 0; placement < kPlacements.size(); ++placement) {
    const Corner corner(kPlacements[placement]);
    ASSERT_EQ(corner.map.planeCount(), 3) << "placement " << placement;
    for (int k = 0; k < 3; ++k) {
      // All walls pass through the corner. 0.03 m / sqrt(50000) is 0.13 mm; the corner lies outside of what is fitted.
      const Plane& plane = corner.map.planes()[k];
      EXPECT_LT(std::abs(plane.distance(corner.T_W_S.t)), 1e-3) << "placement " << placement << " plane " << k;
      EXPECT_LT(angleBetween(plane.normal, corner.normals[k]), 1e-3) << "placement " << placement << " plane " << k;
      EXPECT_GE(plane.offset_m, 0.0);
    }
  }
}

TEST(PlaneMap, ClaimsPointsWithoutBiasAndWithoutMistakes) {
  for (std::size_t placement = 0; placement < kPlacements.size(); ++placement) {
    const Corner corner(kPlacements[placement]);
    for (int k = 0; k < 3; ++k) {
      int claimed = 0, mistaken = 0;
      double sum = 0.0, squares = 0.0;
      for (const Eigen::Vector3d& p : corner.walls[k]) {
        const int plane = corner.map.planeAt(p, corner.normals[k]);
        mistaken += plane >= 0 && plane != k ? 1 : 0;
        if (plane != k) continue;
        const double d = corner.normals[k].dot(p - corner.T_W_S.t);
        ++claimed;
        sum += d;
        squares += d * d;
      }
      EXPECT_EQ(mistaken, 0) << "placement " << placement << " wall " << k;
      ASSERT_GT(claimed, 0.55 * corner.walls[k].size()) << "placement " << placement << " wall " << k;
      EXPECT_LT(std::abs(sum / claimed), 4.0 * kSigma / std::sqrt(claimed))
          << "placement " << placement << " wall " << k;
      EXPECT_NEAR(std::sqrt(squares / claimed), kSigma, 2e-4) << "placement " << placement << " wall " << k;
    }
  }
}

TEST(PlaneMap, GivesNoPlaneNearAnEdgeOrInFreeSpace) {
  const Corner corner(kPlacements[3]);
  const auto at = [&](double x, double y, double z) {
    // Seen square to the first wall.
    return corner.map.planeAt(corner.T_W_S * Eigen::Vector3d(x, y, z), corner.normals[0]);
  };
  EXPECT_EQ(at(3.0, 2.5, 0.0), 0);
  EXPECT_EQ(at(3.0, 2.5, 0.1), 0);
  EXPECT_EQ(at(3.0, 2.5, -0.1), 0);
  EXPECT_EQ(at(3.0, 0.06, 0.0), -1);
  EXPECT_EQ(at(3.0, 0.02, 0.02), -1);
  EXPECT_EQ(at(3.0, 2.5, 0.3), -1);
  EXPECT_EQ(at(30.0, 2.5, 0.0), -1);
  EXPECT_EQ(at(std::numeric_limits<double>::quiet_NaN(), 0.0, 0.0), -1);
  EXPECT_EQ(at(1e300, 0.0, 0.0), -1);
}

TEST(PlaneMap, OneWallAcrossAGapIsOnePlane) {
  Sampler sampler;
  PlaneMap map(exactPoses());
  const Eigen::Vector3d u(2.0, 0.0, 0.0), v(0.0, 0.0, 2.4);
  add(sampler.patch({0.1, 3.33, 0.0}, u, v, 30000), &map);
  add(sampler.patch({4.1, 3.33, 0.0}, u, v, 20000), &map);
  map.extract();
  ASSERT_EQ(map.planeCount(), 1);
  EXPECT_NEAR(map.planes()[0].offset_m, 3.33, 1e-3);
  EXPECT_EQ(map.planeAt({1.0, 3.35, 1.0}, Eigen::Vector3d::UnitY()), 0);
  EXPECT_EQ(map.planeAt({5.0, 3.31, 1.0}, Eigen::Vector3d::UnitY()), 0);
  EXPECT_EQ(map.planeAt({3.1, 3.33, 1.0}, Eigen::Vector3d::UnitY()), -1);  // nothing was seen there
}

TEST(PlaneMap, ParallelPlanesStayApart) {
  // A door in a wall, 10 cm behind it; whatever the position of the voxels' faces.
  for (const double y : {2.0, 2.05, 2.15, 2.31}) {
    Sampler sampler;
    PlaneMap map(exactPoses());
    add(sampler.patch({0.0, y, 0.0}, {4.0, 0.0, 0.0}, {0.0, 0.0, 2.4}, 60000), &map);
    add(sampler.patch({4.0, y + 0.1, 0.0}, {2.4, 0.0, 0.0}, {0.0, 0.0, 2.4}, 40000), &map);
    map.extract();
    ASSERT_EQ(map.planeCount(), 2) << y;
    EXPECT_LT(std::abs(map.planes()[0].distance({2.0, y, 1.2})), 1e-3) << y;
    EXPECT_LT(std::abs(map.planes()[1].distance({5.4, y + 0.1, 1.2})), 1e-3) << y;
    EXPECT_EQ(map.planeAt({2.0, y, 1.2}, Eigen::Vector3d::UnitY()), 0);
    EXPECT_EQ(map.planeAt({5.4, y + 0.1, 1.2}, Eigen::Vector3d::UnitY()), 1);
    EXPECT_EQ(map.planeAt({4.0, y + 0.05, 1.2}, Eigen::Vector3d::UnitY()), -1);
  }
}

TEST(PlaneMap, TakesNoPlaneFromClutterLinesOrFewPoints) {
  PlaneMap map(exactPoses());
  map.extract();
  EXPECT_EQ(map.planeCount(), 0);
  map.addPoint({1.0, 1.0, 1.0});
  map.addPoint({std::numeric_limits<double>::quiet_NaN(), 1.0, 1.0});
  map.addPoint({std::numeric_limits<double>::infinity(), 1.0, 1.0});
  map.extract();
  EXPECT_EQ(map.planeCount(), 0);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> even(0.0, 2.0);
  std::normal_distribution<double> noise(0.0, kSigma);
  for (int i = 0; i < 20000; ++i) map.addPoint({even(random), even(random), even(random)});                // a bush
  for (int i = 0; i < 20000; ++i) map.addPoint({5.0 + noise(random), even(random), 1.0 + noise(random)});  // a ring
  map.extract();
  EXPECT_EQ(map.planeCount(), 0);
  EXPECT_EQ(map.planeAt({1.0, 1.0, 1.0}, Eigen::Vector3d::UnitY()), -1);
}

TEST(PlaneMap, LandmarksKeepTheirNumbersAndNewPlanesGetFreeOnes) {
  Corner corner(kPlacements[3]);
  const std::vector<Plane> found = corner.map.planes();
  ASSERT_EQ(found.size(), 3U);
  // Known from before: the third wall (its estimate 5 mm off) as number 0, one that is gone as 1; number 2 is free.
  Plane shifted = found[2];
  shifted.offset_m += 0.005;
  const Plane gone{Eigen::Vector3d::UnitX(), 50.0};
  corner.map.extract({shifted, gone, std::nullopt});
  const std::vector<Plane>& planes = corner.map.planes();
  ASSERT_EQ(planes.size(), 4U);
  EXPECT_EQ(planes[0].offset_m, shifted.offset_m);  // a landmark's estimate is not the map's to change
  EXPECT_EQ(planes[1].offset_m, 50.0);
  EXPECT_LT(angleBetween(planes[2].normal, found[0].normal), 1e-9);  // the larger one takes the free number
  EXPECT_LT(angleBetween(planes[3].normal, found[1].normal), 1e-9);
  const std::vector<int> number_of = {2, 3, 0};
  for (int k = 0; k < 3; ++k) {
    std::vector<int> claimed(4, 0);
    for (const Eigen::Vector3d& p : corner.walls[static_cast<std::size_t>(k)]) {
      const int plane = corner.map.planeAt(p, corner.normals[static_cast<std::size_t>(k)]);
      if (plane >= 0) ++claimed[static_cast<std::size_t>(plane)];
    }
    for (int plane = 0; plane < 4; ++plane) {
      EXPECT_EQ(claimed[static_cast<std::size_t>(plane)] > 1000, plane == number_of[static_cast<std::size_t>(k)]);
    }
  }
}

TEST(PlaneMap, AWallBesideALandmarkIsANewPlane) {
  const Corner corner(kPlacements[3]);
  PlaneMap map(exactPoses());
  for (const auto& wall : corner.walls) add(wall, &map);
  Plane beside = corner.map.planes()[0];
  beside.offset_m += 0.04;  // more than poses err by
  map.extract({beside});
  EXPECT_EQ(map.planes().size(), 4U);
}

TEST(PlaneMap, SamePointsSameBitsAlsoAfterClear) {
  const auto points = Sampler().patch({0.1, 3.33, 0.0}, {2.0, 0.1, 0.0}, {0.0, 0.2, 2.4}, 30000);
  PlaneMap one(exactPoses()), two(exactPoses());
  add(Sampler().patch({7.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {0.0, 0.0, 2.0}, 1000), &two);
  two.extract();
  two.clear();
  EXPECT_EQ(two.planeCount(), 0);
  add(points, &one);
  add(points, &two);
  one.extract();
  two.extract();
  two.extract();  // of the same points, the same planes
  ASSERT_EQ(one.planeCount(), 1);
  ASSERT_EQ(two.planeCount(), 1);
  EXPECT_EQ(one.planes()[0].normal, two.planes()[0].normal);
  EXPECT_EQ(one.planes()[0].offset_m, two.planes()[0].offset_m);
}

TEST(PlaneMap, RefusesImpossibleParameters) {
  PlaneMap::Params params;
  params.voxel_m = 0.0;
  EXPECT_THROW(PlaneMap{params}, std::invalid_argument);
  params = {};
  params.point_sigma_m = 1.0;  // wider than a voxel
  EXPECT_THROW(PlaneMap{params}, std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
