#include "cocalib/ros/board_view_markers.h"

#include <gtest/gtest.h>

namespace cocalib {
namespace {

TEST(BoardViewMarkers, StandInTheCamerasFrameAtThePicturesTime) {
  BoardGeometry board;
  board.cols = 8;
  board.rows = 6;
  board.square_m = 0.1;
  BoardViews views;
  views.stamp = 1'700'000'006'240'000'000;
  views.T_C_B.t = {-0.3, -0.2, 2.5};
  views.plate_C = {{0.0, 0.1, 2.5}, {0.1, 0.1, 2.5}};
  views.rim_C = {{0.5, 0.1, 2.5}};
  const visualization_msgs::MarkerArray markers = toBoardViewMarkers(views, board, "camera");
  ASSERT_EQ(markers.markers.size(), 3U);
  for (const visualization_msgs::Marker& marker : markers.markers) {
    EXPECT_EQ(marker.header.frame_id, "camera");
    EXPECT_EQ(marker.header.stamp.toNSec(), static_cast<std::uint64_t>(views.stamp));
    EXPECT_EQ(marker.action, static_cast<int>(visualization_msgs::Marker::ADD));
  }
  EXPECT_EQ(markers.markers[0].points.size(), 2U * static_cast<std::size_t>(board.rows + board.cols));
  EXPECT_EQ(markers.markers[0].points.front().z, 2.5);
  EXPECT_EQ(markers.markers[1].points.size(), views.plate_C.size());
  EXPECT_EQ(markers.markers[2].points.size(), views.rim_C.size());
  EXPECT_NE(markers.markers[0].color.b, markers.markers[1].color.b);
  // A plate that is no longer found goes from the picture.
  views.plate_C.clear();
  EXPECT_EQ(toBoardViewMarkers(views, board, "camera").markers[1].action,
            static_cast<int>(visualization_msgs::Marker::DELETE));
}

}  // namespace
}  // namespace cocalib
