#pragma once

#include <visualization_msgs/MarkerArray.h>

#include <string>

#include "cocalib/monitor/board_views.h"

namespace cocalib {

/// Markers for rviz: the camera's view as a blue grid through its corners, the lidar's as orange points with a yellow
/// rim.
visualization_msgs::MarkerArray toBoardViewMarkers(const BoardViews& views, const BoardGeometry& board,
                                                   const std::string& camera_frame);

}  // namespace cocalib
