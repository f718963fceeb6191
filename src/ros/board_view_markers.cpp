#include "cocalib/ros/board_view_markers.h"

#include <vector>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

using visualization_msgs::Marker;

Marker makeMarker(const std::string& space, int type, const BoardViews& views, const std::string& frame, double width) {
  Marker marker;
  marker.header.frame_id = frame;
  marker.header.stamp = toRosTime(views.stamp);
  marker.ns = space;
  marker.type = type;
  marker.pose.orientation.w = 1.0;
  marker.scale.x = marker.scale.y = marker.scale.z = width;
  marker.color.a = 1.0F;
  marker.lifetime = ros::Duration(2.0);
  return marker;
}

Marker makeGrid(const BoardViews& views, const BoardGeometry& board, const std::string& frame) {
  Marker grid = makeMarker("board, by the camera", Marker::LINE_LIST, views, frame, 0.01);
  grid.color.g = 0.6F;
  grid.color.b = 1.0F;
  const auto add = [&](int corner) { grid.points.push_back(toPointMsg(views.T_C_B * board.corner(corner))); };
  for (int row = 0; row < board.rows; ++row) {
    add(row * board.cols);
    add(row * board.cols + board.cols - 1);
  }
  for (int col = 0; col < board.cols; ++col) {
    add(col);
    add((board.rows - 1) * board.cols + col);
  }
  return grid;
}

Marker makePoints(const std::string& space, const std::vector<Eigen::Vector3d>& points_C, const BoardViews& views,
                  const std::string& frame, double width) {
  Marker points = makeMarker(space, Marker::SPHERE_LIST, views, frame, width);
  for (const Eigen::Vector3d& p_C : points_C) points.points.push_back(toPointMsg(p_C));
  if (points_C.empty()) points.action = Marker::DELETE;
  points.color.r = 1.0F;
  return points;
}

}  // namespace

visualization_msgs::MarkerArray toBoardViewMarkers(const BoardViews& views, const BoardGeometry& board,
                                                   const std::string& camera_frame) {
  visualization_msgs::MarkerArray all;
  all.markers.push_back(makeGrid(views, board, camera_frame));
  all.markers.push_back(makePoints("board, by the lidar", views.plate_C, views, camera_frame, 0.025));
  all.markers.back().color.g = 0.45F;
  all.markers.push_back(makePoints("board's rim, by the lidar", views.rim_C, views, camera_frame, 0.035));
  all.markers.back().color.g = 0.9F;
  return all;
}

}  // namespace cocalib
