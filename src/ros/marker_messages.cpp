#include "cocalib/ros/marker_messages.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

using visualization_msgs::Marker;

constexpr double kAxisLengthM = 0.3;
constexpr double kPatchThicknessM = 0.01;
constexpr double kLeastEllipsoidM = 0.002;  // smaller cannot be seen

/// Every marker lasts until it is replaced and has no stamp of its own: rviz shows it in its frame as it stands now.
Marker makeMarker(const std::string& space, int type, const std::string& frame, const Pose& pose) {
  Marker marker;
  marker.header.frame_id = frame;
  marker.ns = space;
  marker.type = type;
  marker.action = Marker::ADD;
  marker.frame_locked = true;
  marker.pose = toPoseMsg(pose);
  marker.color.a = 1.0F;
  return marker;
}

/// @param labelled_axis  at whose end the name stands: the sensors stand near each other, so each takes another one
void addAxes(const std::string& name, const std::string& frame, const Pose& T_frame_sensor,
             const Eigen::Vector3d& labelled_axis, visualization_msgs::MarkerArray* all) {
  Marker axes = makeMarker(name + " axes", Marker::LINE_LIST, frame, T_frame_sensor);
  axes.scale.x = 0.012;
  for (int axis = 0; axis < 3; ++axis) {
    std_msgs::ColorRGBA colour;
    colour.a = 1.0F;
    (axis == 0 ? colour.r : axis == 1 ? colour.g : colour.b) = 1.0F;
    axes.points.push_back(toPointMsg(Eigen::Vector3d::Zero()));
    axes.points.push_back(toPointMsg(kAxisLengthM * Eigen::Vector3d::Unit(axis)));
    axes.colors.insert(axes.colors.end(), 2, colour);
  }
  all->markers.push_back(axes);
  Marker label = makeMarker(name + " label", Marker::TEXT_VIEW_FACING, frame, T_frame_sensor);
  label.pose.position = toPointMsg(T_frame_sensor * (1.15 * kAxisLengthM * labelled_axis));
  label.scale.z = 0.07;
  label.color.r = label.color.g = label.color.b = 1.0F;
  label.text = name;
  all->markers.push_back(label);
}

void addEllipsoid(const std::string& name, const std::string& frame, const Eigen::Vector3d& centre,
                  const Eigen::Matrix3d& covariance, visualization_msgs::MarkerArray* all) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Matrix3d R = solver.eigenvectors();
  if (R.determinant() < 0.0) R.col(0) = -R.col(0);
  Marker ellipsoid = makeMarker(name + " position, 3 sigma", Marker::SPHERE, frame, {Eigen::Quaterniond(R), centre});
  const Eigen::Vector3d diameters = (6.0 * solver.eigenvalues().cwiseMax(0.0).cwiseSqrt()).cwiseMax(kLeastEllipsoidM);
  ellipsoid.scale = toVectorMsg(diameters);
  ellipsoid.color.r = ellipsoid.color.g = 1.0F;
  ellipsoid.color.a = 0.5F;
  all->markers.push_back(ellipsoid);
}

void addBoard(const Pose& T_W_B, const BoardGeometry& board, const std::string& world,
              visualization_msgs::MarkerArray* all) {
  const Eigen::Vector3d centre(0.5 * (board.cols - 1) * board.square_m, 0.5 * (board.rows - 1) * board.square_m, 0.0);
  Marker plate = makeMarker("board", Marker::CUBE, world, {T_W_B.q, T_W_B * centre});
  plate.scale.x = board.width_m.value_or((board.cols + 1) * board.square_m);
  plate.scale.y = board.height_m.value_or((board.rows + 1) * board.square_m);
  plate.scale.z = 0.01;
  plate.color.r = plate.color.g = plate.color.b = 0.9F;
  plate.color.a = 0.6F;
  all->markers.push_back(plate);
  Marker squares = makeMarker("board squares", Marker::CUBE_LIST, world, T_W_B);
  squares.scale.x = squares.scale.y = board.square_m;
  squares.scale.z = 0.014;
  squares.color.r = squares.color.g = squares.color.b = 0.1F;
  for (int row = -1; row < board.rows; ++row) {
    for (int col = -1; col < board.cols; ++col) {
      if ((row + col) % 2 != 0) continue;
      squares.points.push_back(toPointMsg(board.square_m * Eigen::Vector3d(col + 0.5, row + 0.5, 0.0)));
    }
  }
  all->markers.push_back(squares);
}

/// A ring about the arrow, three quarters of a turn, in the sense of the turn.
Marker makeRing(const FrameNames& frames, const Eigen::Vector3d& axis) {
  constexpr double kRadiusM = 0.18;
  constexpr int kSteps = 27;
  Marker ring = makeMarker("motion hint ring", Marker::LINE_STRIP, frames.imu, {});
  ring.scale.x = 0.02;
  const Eigen::Vector3d u = axis.unitOrthogonal(), v = axis.cross(u);
  for (int i = 0; i <= kSteps; ++i) {
    const double angle = 1.5 * M_PI * i / kSteps;
    ring.points.push_back(toPointMsg(0.3 * axis + kRadiusM * (std::cos(angle) * u + std::sin(angle) * v)));
  }
  return ring;
}

Marker makeArrow(const FrameNames& frames, const Eigen::Vector3d& axis) {
  Marker arrow = makeMarker("motion hint", Marker::ARROW, frames.imu, {});
  arrow.scale.x = 0.03;
  arrow.scale.y = 0.07;
  arrow.scale.z = 0.1;
  arrow.points = {toPointMsg(-0.45 * axis), toPointMsg(0.45 * axis)};
  return arrow;
}

/// A colour for each number that differs from those of the numbers next to it.
std_msgs::ColorRGBA colourOf(int number) {
  const double hue = std::fmod(0.618034 * number, 1.0) * 6.0;
  const auto part = [hue](double shift) {
    return static_cast<float>(std::clamp(std::abs(std::fmod(hue + shift, 6.0) - 3.0) - 1.0, 0.0, 1.0));
  };
  std_msgs::ColorRGBA colour;
  colour.r = part(0.0);
  colour.g = part(4.0);
  colour.b = part(2.0);
  colour.a = 0.25F;
  return colour;
}

}  // namespace

visualization_msgs::MarkerArray toMarkers(const CalibrationEstimate& estimate, const std::optional<Pose>& T_W_B,
                                          const std::optional<BoardGeometry>& board, const FrameNames& frames) {
  visualization_msgs::MarkerArray all;
  addAxes("imu", frames.imu, Pose(), Eigen::Vector3d::UnitY(), &all);
  const Calibration& calibration = estimate.calibration;
  if (estimate.camera.valid && estimate.covariance.allFinite()) {
    addAxes("camera", frames.imu, calibration.T_imu_camera, Eigen::Vector3d::UnitY(), &all);
    addEllipsoid("camera", frames.imu, calibration.T_imu_camera.t, estimate.covariance.block<3, 3>(0, 0), &all);
  }
  if (estimate.lidar.valid && estimate.covariance.allFinite()) {
    addAxes("lidar", frames.imu, calibration.T_imu_lidar, Eigen::Vector3d::UnitZ(), &all);
    addEllipsoid("lidar", frames.imu, calibration.T_imu_lidar.t, estimate.covariance.block<3, 3>(6, 6), &all);
  }
  if (board && T_W_B && T_W_B->t.allFinite()) addBoard(*T_W_B, *board, frames.world, &all);
  return all;
}

void addHint(const std::string& words, const std::optional<MotionHint>& hint, const FrameNames& frames,
             visualization_msgs::MarkerArray* all) {
  const Eigen::Vector3d axis = hint ? hint->axis_I : Eigen::Vector3d::UnitZ();
  for (Marker marker : {makeArrow(frames, axis), makeRing(frames, axis)}) {
    marker.action = hint ? static_cast<int>(Marker::ADD) : static_cast<int>(Marker::DELETE);
    marker.color.r = 1.0F;
    marker.color.g = 0.55F;
    all->markers.push_back(marker);
  }
  Marker text = makeMarker("status", Marker::TEXT_VIEW_FACING, frames.imu, {});
  text.pose.position.z = 0.9;
  text.scale.z = 0.08;
  text.color.r = text.color.g = text.color.b = 1.0F;
  text.text = words;
  for (std::size_t at = 0; (at = text.text.find(": ", at)) != std::string::npos; ++at) text.text.replace(at, 2, ":\n");
  if (text.text.empty()) text.action = Marker::DELETE;
  all->markers.push_back(text);
}

visualization_msgs::MarkerArray toPatchMarkers(const std::vector<PlanePatch>& patches, TimeNs stamp,
                                               const std::string& world_frame) {
  visualization_msgs::MarkerArray all;
  for (const PlanePatch& patch : patches) {
    visualization_msgs::Marker marker;
    marker.header.frame_id = world_frame;
    marker.header.stamp = toRosTime(stamp);
    marker.ns = "planes";
    marker.id = patch.number;
    marker.type = visualization_msgs::Marker::CUBE;
    marker.lifetime = ros::Duration(2.0);
    marker.pose = toPoseMsg(patch.T_W_P);
    marker.scale.x = std::max(patch.length_m, kPatchThicknessM);
    marker.scale.y = std::max(patch.width_m, kPatchThicknessM);
    marker.scale.z = kPatchThicknessM;
    marker.color = colourOf(patch.number);
    all.markers.push_back(marker);
  }
  return all;
}

}  // namespace cocalib
