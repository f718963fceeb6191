#include "cocalib/initialization/lidar_camera_initializer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace cocalib {
namespace {

// A camera upside down and half a metre away: nothing here may lean on a nominal mounting.
const Pose kT_L_C{expSo3({-1.7, 0.9, 1.8}), {0.4, -0.3, 0.2}};

BoardGeometry board() {
  BoardGeometry geometry;
  geometry.cols = 5;
  geometry.rows = 7;
  geometry.square_m = 0.1;
  geometry.width_m = 0.64;
  geometry.height_m = 0.84;
  return geometry;
}

/// The plate at T_C_B as a lidar sees it: a grid of returns and crossings of eight rows.
LidarPlate plateAt(const Pose& T_C_B, double noise_m, std::mt19937* random) {
  std::normal_distribution<double> normal;
  const Pose T_L_B = kT_L_C * T_C_B;
  const Eigen::Vector2d half = 0.5 * plateSize(board());
  const auto at = [&](double x, double y) {
    return T_L_B * Eigen::Vector3d(plateCentre(board()) + Eigen::Vector3d(x, y, 0.0));
  };
  LidarPlate plate;
  for (int row = 0; row < 8; ++row) {
    const double y = half.y() * (2.0 * row + 1.0 - 8.0) / 8.0;
    for (int k = 0; k < 40; ++k) {
      const Eigen::Vector3d p = at(half.x() * 0.95 * (k / 19.5 - 1.0), y);
      plate.points_L.push_back(p + noise_m * normal(*random) * p.normalized());
    }
    plate.edge_bearings_L.push_back(at(half.x(), y).normalized());
    plate.edge_bearings_L.push_back(at(-half.x(), y).normalized());
    const double x = half.x() * (2.0 * row + 1.0 - 8.0) / 8.0;
    plate.edge_bearings_L.push_back(at(x, half.y()).normalized());
    plate.edge_bearings_L.push_back(at(x, -half.y()).normalized());
  }
  plate.edge_spacing_rad = 0.0035;
  plate.centre_L = at(0.02 * normal(*random), 0.02 * normal(*random));
  Eigen::Vector3d n = T_L_B.q * Eigen::Vector3d(0.01 * normal(*random), 0.01 * normal(*random), 1.0).normalized();
  if (n.dot(plate.centre_L) < 0.0) n = -n;
  plate.plane_L = {n, n.dot(at(0.0, 0.0))};
  return plate;
}

/// Boards 2 to 3 m before the camera, tilted by up to `tilt_rad`.
std::vector<BoardView> makeViews(int count, double tilt_rad, double noise_m) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<BoardView> views;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d tilt(tilt_rad * uniform(random), tilt_rad * uniform(random), 0.8 * uniform(random));
    const Pose T_C_B{expSo3(tilt), {0.6 * uniform(random), 0.4 * uniform(random), 2.5 + 0.5 * uniform(random)}};
    views.push_back({T_C_B, {plateAt(T_C_B, noise_m, &random)}});
  }
  return views;
}

void expectNear(const Pose& T, double max_m, double max_rad) {
  const Vector6d error = T.minus(kT_L_C);
  EXPECT_LT(error.head<3>().norm(), max_m);
  EXPECT_LT(error.tail<3>().norm(), max_rad);
}

TEST(LidarCameraInitializer, ExactViewsGiveTheExactTransform) {
  const auto start = initializeLidarCamera(makeViews(6, 0.5, 0.0), board(), {});
  ASSERT_TRUE(start);
  EXPECT_EQ(start->used_views, 6);
  expectNear(start->T_lidar_camera, 1e-6, 1e-6);
  expectNear(start->closed_form_T_lidar_camera, 0.05, 0.03);  // normals were given with 0.01 rad of error
}

TEST(LidarCameraInitializer, NoiseAveragesOutAndSigmaSaysHowFar) {
  const auto start = initializeLidarCamera(makeViews(12, 0.5, 0.03), board(), {});
  ASSERT_TRUE(start);
  expectNear(start->T_lidar_camera, 0.01, 0.006);
  // 3 cm along the ray, times the cosine of an incidence of 20 to 45 deg.
  EXPECT_LT(start->plane_rms_m, 0.03);
  EXPECT_GT(start->plane_rms_m, 0.02);
  const Vector6d error = start->T_lidar_camera.minus(kT_L_C);
  for (int i = 0; i < 6; ++i) EXPECT_LT(std::abs(error[i]), 4.0 * start->sigma[i]) << i;
  EXPECT_GT(start->sigma.minCoeff(), 0.0);
}

TEST(LidarCameraInitializer, WrongPlatesAreOutvoted) {
  std::vector<BoardView> views = makeViews(10, 0.5, 0.02);
  std::mt19937 random(3);
  const Pose cupboard{expSo3({0.1, 0.7, 0.0}), {1.0, -0.4, 3.5}};  // stands in every view at the same place
  for (BoardView& view : views) view.plates.insert(view.plates.begin(), plateAt(cupboard, 0.02, &random));
  views[4].plates.pop_back();  // and hides the board once
  const auto start = initializeLidarCamera(views, board(), {});
  ASSERT_TRUE(start);
  expectNear(start->T_lidar_camera, 0.012, 0.008);
  for (std::size_t i = 0; i < views.size(); ++i) EXPECT_EQ(start->views[i].plate, i == 4 ? -1 : 1) << "view " << i;
}

TEST(LidarCameraInitializer, HalfTurnedBoardsAreTheSame) {
  std::vector<BoardView> views = makeViews(8, 0.5, 0.0);
  const Pose half_turn{expSo3({0.0, 0.0, M_PI}), 2.0 * plateCentre(board())};
  for (std::size_t i = 0; i < views.size(); i += 2) views[i].T_C_B = views[i].T_C_B * half_turn;
  const auto start = initializeLidarCamera(views, board(), {});
  ASSERT_TRUE(start);
  expectNear(start->T_lidar_camera, 1e-5, 1e-5);
}

TEST(LidarCameraInitializer, EstimatesAConstantRangeError) {
  std::vector<BoardView> views = makeViews(12, 0.6, 0.01);
  for (BoardView& view : views) {
    for (Eigen::Vector3d& p : view.plates[0].points_L) p -= 0.03 * p.normalized();
  }
  LidarCameraInitializerParams params;
  params.estimate_range_bias = true;
  const auto start = initializeLidarCamera(views, board(), params);
  ASSERT_TRUE(start);
  EXPECT_NEAR(start->range_bias_m, 0.03, 0.005);
  expectNear(start->T_lidar_camera, 0.01, 0.005);
}

TEST(LidarCameraInitializer, SaysWhatIsMissing) {
  std::string reason;
  EXPECT_FALSE(initializeLidarCamera({}, board(), {}, &reason));
  EXPECT_NE(reason.find("0 times"), std::string::npos) << reason;
  EXPECT_FALSE(initializeLidarCamera(makeViews(2, 0.5, 0.0), board(), {}, &reason));
  EXPECT_NE(reason.find("2 times"), std::string::npos) << reason;
  EXPECT_FALSE(initializeLidarCamera(makeViews(8, 0.02, 0.0), board(), {}, &reason));
  EXPECT_NE(reason.find("tilted"), std::string::npos) << reason;

  // Plates that have nothing to do with the pictures.
  std::vector<BoardView> views = makeViews(6, 0.5, 0.0);
  const std::vector<BoardView> others = makeViews(13, 0.5, 0.0);
  for (std::size_t i = 0; i < views.size(); ++i) views[i].plates = others[12 - i].plates;
  EXPECT_FALSE(initializeLidarCamera(views, board(), {}, &reason));
  EXPECT_FALSE(reason.empty());
}

}  // namespace
}  // namespace cocalib
