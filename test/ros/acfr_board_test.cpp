/// The real recording of the ACFR: 18 static views of a chessboard by a VLP-16 and a fisheye camera.

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <stdexcept>
#include <string>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/board_calibration.h"

namespace cocalib {
namespace {

// Tests run in the repository's root; recordings lie beside it.
const std::string kBag = "../shared/data/acfr_vlp16_board/acfr_vlp16_board.bag";

/// The recording's authors' own result, the mean of 50 runs (spread 0.7 deg, 4 to 30 mm): no independent truth.
Pose referenceTransform() {
  const auto turn = [](double angle, const Eigen::Vector3d& axis) { return Eigen::AngleAxisd(angle, axis); };
  const Eigen::Quaterniond q = turn(-1.4929, Eigen::Vector3d::UnitZ()) * turn(-0.0209, Eigen::Vector3d::UnitY()) *
                               turn(-1.6954, Eigen::Vector3d::UnitX());
  return {q, {0.0626, 0.0039, -0.1958}};
}

TEST(AcfrBoard, FindsBoardsAndTransformWithoutAnyGuess) {
  if (!std::ifstream(kBag).good()) GTEST_SKIP() << kBag << " is not there";
  const RigConfig rig = loadRigFile("cfg/rigs/acfr.yaml");
  const BoardCalibration calibration = calibrateFromBoards(kBag, rig);
  EXPECT_EQ(calibration.images, 18);
  EXPECT_GE(calibration.images_with_board, 16);
  ASSERT_TRUE(calibration.start) << calibration.reason;
  EXPECT_GE(calibration.start->used_views, 14);

  const Vector6d error = calibration.start->T_lidar_camera.minus(referenceTransform());
  EXPECT_LT(error.tail<3>().norm(), 1.5 * M_PI / 180.0);
  EXPECT_LT(error.head<3>().norm(), 0.040);
  EXPECT_LT(calibration.start->plane_rms_m, 0.03);
  const Vector6d closed_form_error = calibration.start->closed_form_T_lidar_camera.minus(referenceTransform());
  EXPECT_LT(closed_form_error.tail<3>().norm(), 1.5 * M_PI / 180.0);
  EXPECT_LT(closed_form_error.head<3>().norm(), 0.040);
  RecordProperty("rotation_error_deg", std::to_string(error.tail<3>().norm() * 180.0 / M_PI));
  RecordProperty("translation_error_m", std::to_string(error.head<3>().norm()));
}

TEST(AcfrBoard, SaysWhatIsWrongWithTheBoardsSize) {
  if (!std::ifstream(kBag).good()) GTEST_SKIP() << kBag << " is not there";
  RigConfig rig = loadRigFile("cfg/rigs/acfr.yaml");
  rig.target->cols = 8;
  rig.target->rows = 6;
  const BoardCalibration calibration = calibrateFromBoards(kBag, rig);
  EXPECT_FALSE(calibration.start);
  EXPECT_EQ(calibration.images_with_board, 0);
  EXPECT_NE(calibration.reason.find("0 times"), std::string::npos) << calibration.reason;
}

TEST(AcfrBoard, NamesTheTopicThatIsMissing) {
  if (!std::ifstream(kBag).good()) GTEST_SKIP() << kBag << " is not there";
  RigConfig rig = loadRigFile("cfg/rigs/acfr.yaml");
  rig.lidar->topic = "/nothing";
  try {
    calibrateFromBoards(kBag, rig);
    FAIL() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nothing"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace cocalib
