#include "cocalib/ros/marker_messages.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace cocalib {
namespace {

TEST(MarkerMessages, ShowAPatchAsAThinBoxOfItsSize) {
  PlanePatch patch;
  patch.number = 3;
  patch.T_W_P.t << 2.0, 0.0, 1.0;
  patch.length_m = 4.0;
  patch.width_m = 2.0;
  const visualization_msgs::MarkerArray markers = toPatchMarkers({patch}, 5, "world");
  ASSERT_EQ(markers.markers.size(), 1U);
  const visualization_msgs::Marker& box = markers.markers.front();
  EXPECT_EQ(box.id, 3);
  EXPECT_EQ(box.header.frame_id, "world");
  EXPECT_EQ(box.type, static_cast<int>(visualization_msgs::Marker::CUBE));
  EXPECT_DOUBLE_EQ(box.pose.position.x, 2.0);
  EXPECT_DOUBLE_EQ(box.scale.x, 4.0);
  EXPECT_DOUBLE_EQ(box.scale.y, 2.0);
  EXPECT_LT(box.scale.z, 0.05);
  EXPECT_LT(box.color.a, 1.0F);
}

std::set<std::string> namesOf(const visualization_msgs::MarkerArray& markers) {
  std::set<std::string> names;
  for (const visualization_msgs::Marker& marker : markers.markers) names.insert(marker.ns);
  return names;
}

TEST(MarkerMessages, ShowSensorsThatAreKnown) {
  CalibrationEstimate estimate;
  const std::set<std::string> nothing = namesOf(toMarkers(estimate, std::nullopt, std::nullopt, FrameNames()));
  estimate.lidar.valid = true;
  estimate.covariance.diagonal().setConstant(1e-6);
  const std::set<std::string> lidar = namesOf(toMarkers(estimate, std::nullopt, std::nullopt, FrameNames()));
  EXPECT_EQ(nothing.count("lidar axes"), 0U);
  EXPECT_EQ(lidar.count("lidar axes"), 1U);
  EXPECT_EQ(lidar.count("camera axes"), 0U);
  EXPECT_GT(lidar.size(), nothing.size() + 1U);  // its ellipsoid
}

TEST(MarkerMessages, SayWhatToDoOnceAndDrawTheTurn) {
  const MotionHint hint = {Eigen::Vector3d::UnitY(), "turn about imu y, back and forth: it helps"};
  visualization_msgs::MarkerArray markers;
  addHint("converging: " + hint.words, hint, FrameNames(), &markers);
  ASSERT_EQ(namesOf(markers), (std::set<std::string>{"motion hint", "motion hint ring", "status"}));
  EXPECT_EQ(markers.markers.back().text, "converging:\nturn about imu y, back and forth:\nit helps");
  EXPECT_GT(markers.markers[0].points[1].y, markers.markers[0].points[0].y);
  markers.markers.clear();
  addHint("converged", std::nullopt, FrameNames(), &markers);
  EXPECT_EQ(markers.markers[0].action, static_cast<int>(visualization_msgs::Marker::DELETE));
}

}  // namespace
}  // namespace cocalib
