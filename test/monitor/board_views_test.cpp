#include "cocalib/monitor/board_views.h"

#include <gtest/gtest.h>

#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// A picture of the simulated rig in motion with the sweep of its time; corners and returns come without pictures.
struct SeenBoard {
  SeenBoard() {
    const sim::Scene world(s);
    const sim::Trajectory trajectory(s);
    constexpr int kSweep = 62, kPicture = 312;  // 6.2 s, in the middle of the sweep
    const std::vector<ImuSample> imu = sim::simulateImu(s, trajectory);
    scene.scan = sim::simulateScan(s, world, trajectory, kSweep).scan;
    scene.image.stamp = sim::imageStamp(s, kPicture);
    for (const ImuSample& sample : imu) {
      if (std::abs(toSeconds(sample.stamp - scene.image.stamp)) < 0.2) scene.imu.push_back(sample);
    }
    scene.state = trajectory.stateAt(scene.image.stamp);
    corners = sim::simulateBoard(s, world, trajectory, kPicture);
    truth.T_imu_camera = s.camera.T_imu_camera();
    truth.T_imu_lidar = s.lidar.T_imu_lidar();
  }
  std::optional<BoardViews> view(const Calibration& calibration) const {
    return viewBoard(scene, *corners, calibration, s.camera.cameraModel(), s.board.geometry(), s.lidar.range_noise_m);
  }

  sim::Scenario s;
  OverlayScene scene;
  std::optional<BoardObservation> corners;
  Calibration truth;
};

TEST(BoardViews, MeetWhereTheCalibrationIsRight) {
  const SeenBoard seen;
  ASSERT_TRUE(seen.corners);
  const std::optional<BoardViews> views = seen.view(seen.truth);
  ASSERT_TRUE(views);
  ASSERT_GT(views->plate_C.size(), 100U);
  EXPECT_GT(views->rim_C.size(), 4U);
  const Eigen::Vector2d half = 0.5 * plateSize(seen.s.board.geometry());
  double sum = 0.0;
  for (const Eigen::Vector3d& p_C : views->plate_C) {
    const Eigen::Vector3d p = views->T_C_B.inverse() * p_C - plateCentre(seen.s.board.geometry());
    EXPECT_LT(std::abs(p.z()), 5.0 * seen.s.lidar.range_noise_m);
    EXPECT_LT((p.head<2>().cwiseAbs() - half).maxCoeff(), 0.05);
    sum += p.z();
  }
  // 0.03 m of noise over a hundred points and more: 3 mm; 5 mm more for the camera's own pose at 3 m.
  EXPECT_NEAR(sum / static_cast<double>(views->plate_C.size()), 0.0, 0.014);
}

TEST(BoardViews, StandApartByTheErrorOfTheCalibration) {
  const SeenBoard seen;
  ASSERT_TRUE(seen.corners);
  const std::optional<BoardViews> right = seen.view(seen.truth);
  ASSERT_TRUE(right);
  // The lidar is believed to stand 6 cm too near to the board.
  Calibration wrong = seen.truth;
  const Eigen::Vector3d normal_I = wrong.T_imu_camera.q * (right->T_C_B.q * Eigen::Vector3d::UnitZ());
  wrong.T_imu_lidar.t += 0.06 * normal_I;
  const std::optional<BoardViews> views = seen.view(wrong);
  ASSERT_TRUE(views);
  ASSERT_GT(views->plate_C.size(), 50U);
  double sum = 0.0;
  for (const Eigen::Vector3d& p_C : views->plate_C) sum += (views->T_C_B.inverse() * p_C).z();
  EXPECT_NEAR(sum / static_cast<double>(views->plate_C.size()), 0.06, 0.014);
}

}  // namespace
}  // namespace cocalib
