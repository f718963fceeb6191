#include "cocalib/sim/scene.h"

#include <cmath>
#include <limits>

#include "cocalib/sim/drive.h"

namespace cocalib::sim {
namespace {

// A ray must leave the surface it starts on.
constexpr double kMinRange_m = 1e-6;

Rectangle rectangle(const Eigen::Vector3d& center, const Eigen::Vector3d& normal, const Eigen::Vector3d& u,
                    double half_u, double half_v) {
  Rectangle r;
  r.center = center;
  r.normal = normal.normalized();
  r.u = (u - r.normal * r.normal.dot(u)).normalized();
  r.v = r.normal.cross(r.u);
  r.half_u = half_u;
  r.half_v = half_v;
  return r;
}

std::vector<Rectangle> room() {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  return {// walls, floor, ceiling
          rectangle({0, 4, 2}, x, y, 4, 2), rectangle({10, 4, 2}, -x, y, 4, 2), rectangle({5, 0, 2}, y, x, 5, 2),
          rectangle({5, 8, 2}, -y, x, 5, 2), rectangle({5, 4, 0}, z, x, 5, 4), rectangle({5, 4, 4}, -z, x, 5, 4),
          // cupboard
          rectangle({2.0, 6.4, 0.5}, -y, x, 0.6, 0.5), rectangle({2.6, 6.8, 0.5}, x, y, 0.4, 0.5),
          rectangle({2.0, 6.8, 1.0}, z, x, 0.6, 0.4),
          // pillar
          rectangle({7.5, 1.3, 2}, -x, y, 0.3, 2), rectangle({7.8, 1.6, 2}, y, x, 0.3, 2),
          // leaning panel
          rectangle({1.0, 2.0, 1.5}, {1, 0.5, 0.3}, y, 0.75, 0.75)};
}

/// So long that its ends are beyond the lidar's reach.
std::vector<Rectangle> corridor() {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
  const double half = 300.0;
  return {rectangle({4.2, 2.2, 1.7}, y, x, half, 1.7), rectangle({4.2, 5.8, 1.7}, -y, x, half, 1.7),
          rectangle({4.2, 4.0, 0.0}, z, x, half, 1.8), rectangle({4.2, 4.0, 3.4}, -z, x, half, 1.8)};
}

std::vector<Rectangle> facade() {
  return {rectangle({7.2, 4.0, 1.7}, -Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), 60.0, 30.0)};
}

/// An upright wall from one point of the floor to another, `height` high.
Rectangle wall(double x0, double y0, double x1, double y1, double height) {
  const Eigen::Vector3d along(x1 - x0, y1 - y0, 0.0);
  return rectangle({0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * height}, {-along.y(), along.x(), 0.0}, along,
                   0.5 * along.norm(), 0.5 * height);
}

/// Both faces and both ends of a wall of 0.2 m, from one point of the floor to another along x or y.
void addPartition(double x0, double y0, double x1, double y1, double height, std::vector<Rectangle>* out) {
  const Eigen::Vector2d along = Eigen::Vector2d(x1 - x0, y1 - y0).normalized(), half(-0.1 * along.y(), 0.1 * along.x());
  const double dx = half.x(), dy = half.y();
  out->push_back(wall(x0 + dx, y0 + dy, x1 + dx, y1 + dy, height));
  out->push_back(wall(x1 - dx, y1 - dy, x0 - dx, y0 - dy, height));
  out->push_back(wall(x0 + dx, y0 + dy, x0 - dx, y0 - dy, height));
  out->push_back(wall(x1 + dx, y1 + dy, x1 - dx, y1 - dy, height));
}

/// Six rooms around a closed court of 14 x 8 m, in a building of 24 x 18 m; doors
/// of 2.6 m where the drive passes. In each room something else leans or stands.
std::vector<Rectangle> building() {
  constexpr double kHeight = 3.4, kDoor = 1.3;
  const double X = drive::kMiddleX, Y = drive::kMiddleY;
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), z = Eigen::Vector3d::UnitZ();
  std::vector<Rectangle> out = {rectangle({X, Y, 0}, z, x, 12, 9), rectangle({X, Y, kHeight}, -z, x, 12, 9)};
  const auto outline = [&](double half_x, double half_y) {
    out.push_back(wall(X - half_x, Y - half_y, X + half_x, Y - half_y, kHeight));
    out.push_back(wall(X + half_x, Y - half_y, X + half_x, Y + half_y, kHeight));
    out.push_back(wall(X + half_x, Y + half_y, X - half_x, Y + half_y, kHeight));
    out.push_back(wall(X - half_x, Y + half_y, X - half_x, Y - half_y, kHeight));
  };
  outline(12, 9);
  outline(7, 4);
  // Partitions across the ring of rooms, each with a door; the drive passes at 6.4 m from the long middle line and at
  // 9.4 m from the short one.
  const auto acrossX = [&](double at_x, double side) {
    addPartition(X + at_x, Y + side * 4, X + at_x, Y + side * (6.4 - kDoor), kHeight, &out);
    addPartition(X + at_x, Y + side * (6.4 + kDoor), X + at_x, Y + side * 9, kHeight, &out);
  };
  acrossX(4.0, 1.0);
  acrossX(-4.0, 1.0);
  acrossX(4.5, -1.0);
  acrossX(-3.5, -1.0);
  addPartition(X + 7, Y + 0.3, X + 9.4 - kDoor, Y + 0.3, kHeight, &out);
  addPartition(X + 9.4 + kDoor, Y + 0.3, X + 12, Y + 0.3, kHeight, &out);
  out.push_back(rectangle({X - 11.3, Y - 3.0, 1.2}, {1, 0.4, 0.3}, Eigen::Vector3d::UnitY(), 0.8, 0.9));
  out.push_back(rectangle({X + 11.2, Y + 5.0, 1.2}, {-1, -0.5, 0.2}, Eigen::Vector3d::UnitY(), 0.9, 1.0));
  out.push_back(rectangle({X + 0.5, Y + 8.5, 1.1}, {0.3, -1, 0.3}, x, 1.0, 0.8));
  out.push_back(rectangle({X - 0.5, Y - 8.4, 1.0}, {-0.4, 1, 0.2}, x, 1.1, 0.9));
  return out;
}

std::vector<Rectangle> surfacesOf(Place place) {
  switch (place) {
    case Place::kCorridor:
      return corridor();
    case Place::kWall:
      return facade();
    case Place::kBuilding:
      return building();
    case Place::kRoom:
      break;
  }
  return room();
}

}  // namespace

Scene::Scene(const Scenario& scenario) : rectangles_(surfacesOf(scenario.place)) {
  if (!scenario.board.present) return;
  const Scenario::Board& board = scenario.board;
  // Facing the rig: x to the right (-y of W), y down, z away from the rig; then turned about the axes of the plate as
  // seen from the front, with x right, y up and z towards the rig.
  Eigen::Matrix3d R_W_front;
  R_W_front << 0, 0, -1, -1, 0, 0, 0, 1, 0;
  R_W_front *= rotationFromRpy({board.tilt_rpy[0], board.tilt_rpy[1], board.tilt_rpy[2]});
  const Eigen::Vector3d center = restPosition() + Eigen::Vector3d(board.distance_m, 0.1, 0.15);
  Eigen::Matrix3d R_W_B;
  R_W_B << R_W_front.col(0), -R_W_front.col(1), -R_W_front.col(2);
  T_W_B_.q = Eigen::Quaterniond(R_W_B);
  const Eigen::Vector3d half_span(0.5 * (board.cols - 1) * board.square_m, 0.5 * (board.rows - 1) * board.square_m, 0);
  T_W_B_.t = center - T_W_B_.q * half_span;

  Rectangle plate = rectangle(center, R_W_front.col(2), R_W_front.col(0), 0.5 * board.width_m, 0.5 * board.height_m);
  plate.is_board = true;
  board_index_ = static_cast<int>(rectangles_.size());
  rectangles_.push_back(plate);
}

std::optional<Scene::Hit> Scene::raycast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  Hit best{std::numeric_limits<double>::infinity(), -1};
  for (std::size_t i = 0; i < rectangles_.size(); ++i) {
    const Rectangle& r = rectangles_[i];
    const double approach = r.normal.dot(direction);
    if (approach == 0.0) continue;
    const Eigen::Vector3d to_center = r.center - origin;
    const double range = r.normal.dot(to_center) / approach;
    if (!(range > kMinRange_m) || range >= best.range) continue;
    const Eigen::Vector3d p = range * direction - to_center;
    if (std::abs(p.dot(r.u)) > r.half_u || std::abs(p.dot(r.v)) > r.half_v) continue;
    best = {range, static_cast<int>(i)};
  }
  if (best.index < 0) return std::nullopt;
  return best;
}

bool Scene::visible(const Eigen::Vector3d& eye, const Eigen::Vector3d& point) const {
  const Eigen::Vector3d ray = point - eye;
  const double range = ray.norm();
  const std::optional<Hit> hit = raycast(eye, ray / range);
  return !hit || hit->range > range - 1e-6;
}

}  // namespace cocalib::sim
