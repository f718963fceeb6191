// Which point lies on what: the part of LidarGroup that looks at every point.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <thread>

#include "cocalib/estimation/lidar_group.h"
#include "cocalib/factors/point_factors.h"
#include "lidar_pose.h"

namespace cocalib {
namespace {

constexpr double kBoardSurround_m = 0.6;  // looked at beyond the plate's corners: what makes it free-standing

/// The points of a sweep by time, in bins of equal length.
class TimeBins {
 public:
  TimeBins(const LidarScan& scan, double bin_s) : points_(scan.points), per_s_(1.0 / bin_s) {
    int bins = 0;
    bool in_order = true;
    for (const LidarPoint& point : points_) {
      const int own = binOf(point);
      in_order = in_order && own + 1 >= bins;
      bins = std::max(bins, own + 1);
    }
    if (!in_order) sort(bins);
  }
  std::size_t size() const { return points_.size(); }
  /// Index in the sweep of the k-th point.
  std::size_t index(std::size_t k) const { return sorted_.empty() ? k : sorted_[k]; }
  int bin(std::size_t k) const { return binOf(points_[index(k)]); }

 private:
  int binOf(const LidarPoint& point) const {
    constexpr double kMaxBins = 4096.0;  // 16 s: no sweep is longer, and what lies about its time costs no memory
    const double bin = point.offset_s * per_s_;
    return bin > 0.0 && bin < kMaxBins ? static_cast<int>(bin) : 0;
  }
  /// A counting sort: sweeps have few bins and come in any order.
  void sort(int bins) {
    std::vector<std::size_t> place(static_cast<std::size_t>(bins) + 1, 0);
    for (const LidarPoint& point : points_) ++place[static_cast<std::size_t>(binOf(point)) + 1];
    for (std::size_t bin = 1; bin < place.size(); ++bin) place[bin] += place[bin - 1];
    sorted_.resize(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      sorted_[place[static_cast<std::size_t>(binOf(points_[i]))]++] = static_cast<std::uint32_t>(i);
    }
  }

  const std::vector<LidarPoint>& points_;
  double per_s_;
  std::vector<std::uint32_t> sorted_;  // empty: they stand in order
};

/// Whether a point is one of about one in `stride`. Not every so-many-th: that would pick whole rings.
bool isChosen(std::size_t index, std::uint32_t stride) {
  return stride <= 1 || (static_cast<std::uint32_t>(index) * 2654435761U >> 8) % stride == 0;
}

std::uint32_t strideFor(std::size_t points, std::size_t wanted) {
  return wanted == 0 ? 1 : static_cast<std::uint32_t>((points + wanted - 1) / std::max<std::size_t>(1, wanted));
}

/// The directions in which a sphere is seen from the origin.
class ViewCone {
 public:
  ViewCone(const Eigen::Vector3d& centre, double radius_m) : axis_(centre.normalized().cast<float>()) {
    const double sine = radius_m / centre.norm();
    cosine_ = sine < 1.0 ? static_cast<float>(std::sqrt(1.0 - sine * sine)) : -1.0F;
  }
  bool holds(const Eigen::Vector3f& p) const { return axis_.dot(p) >= cosine_ * p.norm(); }

 private:
  Eigen::Vector3f axis_;
  float cosine_;  // of the cone's half angle; from within the sphere everything is seen
};

/// Which edge of the plate a row of beams leaves it over: index in WindowState::outline; -1: near a corner, or over
/// none. A row that runs almost along an edge tells where that edge is all the better, as long as it does cross it.
/// @param hit_B, gap_B  middle and step from the last beam on the plate to the first beyond, in the plate's plane
int edgeCrossed(const Eigen::Vector3d& hit_B, const Eigen::Vector3d& gap_B, const Eigen::Vector4d& outline) {
  constexpr double kNear_m = 0.1, kCorner_m = 0.05;
  constexpr double kLeastSlant = 0.1;  // of the step; flatter ones may as well lead back onto the plate
  int found = -1;
  double nearest = kNear_m;
  for (int i = 0; i < 4; ++i) {
    const double distance = std::abs(hit_B[i / 2] - outline[i]);
    if (distance >= nearest) continue;
    nearest = distance;
    found = i;
  }
  if (found < 0) return -1;
  const int axis = found / 2, other = 1 - axis;
  const double clear = kCorner_m + 0.5 * std::abs(gap_B[other]);
  if (hit_B[other] < outline[2 * other] + clear || hit_B[other] > outline[2 * other + 1] - clear) return -1;
  const double outwards = found % 2 == 1 ? gap_B[axis] : -gap_B[axis];
  return outwards > kLeastSlant * gap_B.head<2>().norm() ? found : -1;
}

void addPoint(const Eigen::Vector3d& p_L, const Eigen::Vector3d& ray_L, double range2, double variance,
              PlanePoints* points) {
  const Eigen::Vector4d h = p_L.homogeneous();
  points->moment.noalias() += (1.0 / variance) * h * h.transpose();
  points->noise.noalias() += (range2 / variance) * ray_L * ray_L.transpose();
}

/// Moves a point seen dt after (before: dt < 0) the pose's time to that time: the static point in the moving lidar
/// frame.
Eigen::Vector3d deskew(const Eigen::Vector3f& p, double dt, const Eigen::Vector3d& v_L, const Eigen::Vector3d& w_L) {
  const Eigen::Vector3d point = p.cast<double>();
  return point + dt * (w_L.cross(point) + v_L);
}

}  // namespace

template <typename Visit>
void LidarGroup::forEachBin(const WindowState& state, const InertialChain& chain, const Scan& whole,
                            Visit&& visit) const {
  const LidarScan& scan = *whole.raw;
  const TimeBins bins(scan, params_.bin_s);
  for (std::size_t begin = 0; begin < bins.size();) {
    const int bin = bins.bin(begin);
    std::size_t end = begin;
    while (end < bins.size() && bins.bin(end) == bin) ++end;
    const double middle_s = (bin + 0.5) * params_.bin_s;
    const TimeNs stamp = scan.stamp + toNs(middle_s);
    if (stamp < whole.from) {
      begin = end;
      continue;
    }
    const int node = lidarNode(state, stamp);
    const TimedSensorPose pose = lidarPose(state, chain, node, stamp);
    const Eigen::Vector3d v_L = pose.T_W_S.q.conjugate() * pose.v_W;
    const auto point = [&](std::size_t index) {
      const LidarPoint& raw = scan.points[index];
      return deskew(raw.p, raw.offset_s - middle_s, v_L, pose.w_S);
    };
    const auto forEach = [&](const auto& use) {
      for (std::size_t k = begin; k < end; ++k) use(bins.index(k));
    };
    visit(stamp, node, pose, point, forEach);
    begin = end;
  }
}

void LidarGroup::fillMap(const WindowState& state, const InertialChain& chain, int first_scan, std::uint32_t stride,
                         PlaneMap* map) const {
  for (std::size_t s = static_cast<std::size_t>(first_scan); s < scans_.size(); ++s) {
    forEachBin(state, chain, scans_[s],
               [&](TimeNs, int, const TimedSensorPose& pose, const auto& point, const auto& forEach) {
                 const Eigen::Matrix3d R_W_L = pose.T_W_S.R();
                 forEach([&](std::size_t index) {
                   if (isChosen(index, stride)) map->addPoint(R_W_L * point(index) + pose.T_W_S.t);
                 });
               });
  }
}

void LidarGroup::weighRepeats(const WindowState& state, const InertialChain& chain) {
  for (Scan& scan : scans_) {
    if (scan.weight) continue;
    const double half_s = scan.raw->points.empty() ? 0.0 : 0.5 * scan.raw->points.back().offset_s;
    const TimeNs middle = scan.raw->stamp + toNs(half_s);
    scan.weight = repeats_.next(lidarPose(state, chain, lidarNode(state, middle), middle).T_W_S);
  }
}

void LidarGroup::link(const WindowState& state, const InertialChain& chain, const PlaneMap& map, int first_scan,
                      double slack_m, bool board_known, std::size_t points) {
  weighRepeats(state, chain);
  const auto linkFrom = [&](std::size_t first, std::size_t stride) {
    for (std::size_t s = first; s < scans_.size(); s += stride) {
      Scan& scan = scans_[s];
      if (board_known && params_.board) findBoard(state, chain, slack_m, &scan);
      linkScan(state, chain, map, slack_m, points, &scan);
      scan.edges.clear();
      if (scan.board) linkEdges(state, chain, *scan.board, &scan);
    }
  };
  // Sweeps do not depend on each other; every other one goes to a second thread.
  const auto first = static_cast<std::size_t>(first_scan);
  std::thread second;
  if (first + 1 < scans_.size()) second = std::thread([&] { linkFrom(first + 1, 2); });
  linkFrom(first, 2);
  if (second.joinable()) second.join();
}

void LidarGroup::findBoard(const WindowState& state, const InertialChain& chain, double slack_m, Scan* whole) const {
  // The board's pose is as uncertain as the estimate; at 3 m a centimetre is about 3 mrad.
  const double tolerance_m = std::max(slack_m, 0.01), tolerance_rad = std::max(0.3 * slack_m, 0.003);
  const Scan& scan = *whole;
  const bool in_part = scan.raw->points.empty() || scan.from > 0;  // half of a sweep may show half of the board
  if (!in_part && scan.searched_m <= tolerance_m) return;          // the same points would be found again
  whole->board.reset();
  if (in_part) return;
  whole->searched_m = tolerance_m;
  const TimeNs middle = scan.raw->stamp + toNs(0.5 * scan.raw->points.back().offset_s);
  const Pose T_L_W = lidarPose(state, chain, lidarNode(state, middle), middle).T_W_S.inverse();
  const Pose T_L_B = T_L_W * state.T_W_B;
  // Only the beams around the plate matter: a tenth of a sweep, or nothing of it.
  const double reach_m = 0.5 * plateSize(*params_.board).norm() + kBoardSurround_m + slack_m;
  std::vector<std::pair<int, Eigen::Vector3f>> around;
  forEachBin(state, chain, scan, [&](TimeNs, int, const TimedSensorPose& pose, const auto& point, const auto& forEach) {
    const Pose T_M_L = T_L_W * pose.T_W_S;
    const ViewCone cone(T_M_L.inverse() * (T_L_B * plateCentre(*params_.board)), reach_m);
    forEach([&](std::size_t index) {
      if (!cone.holds(scan.raw->points[index].p)) return;
      around.emplace_back(static_cast<int>(index), Eigen::Vector3d(T_M_L * point(index)).cast<float>());
    });
  });
  std::sort(around.begin(), around.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  LidarScan part;
  part.stamp = scan.raw->stamp;
  std::vector<Eigen::Vector3f> points_L;
  for (const auto& [index, p_L] : around) {
    part.points.push_back(scan.raw->points[static_cast<std::size_t>(index)]);
    points_L.push_back(p_L);
  }
  whole->board = segmentBoard(part, points_L, T_L_B, *params_.board, params_.range_noise_m, tolerance_m, tolerance_rad);
  if (!whole->board) return;
  for (int& index : whole->board->points) index = around[static_cast<std::size_t>(index)].first;
  for (BoardEdgeCrossing& crossing : whole->board->crossings) {
    crossing.on_index = around[static_cast<std::size_t>(crossing.on_index)].first;
  }
}

void LidarGroup::linkScan(const WindowState& state, const InertialChain& chain, const PlaneMap& map, double slack_m,
                          std::size_t points, Scan* scan) const {
  constexpr std::int16_t kNone = -1, kOnBoard = -2;
  scan->bins.clear();
  scan->square_m2 = scan->range_square_m2 = 0.0;
  scan->points = scan->points_seen = scan->range_points = 0;
  scan->plane.assign(scan->raw->points.size(), kNone);
  if (scan->board) {
    for (const int index : scan->board->points) scan->plane[static_cast<std::size_t>(index)] = kOnBoard;
  }
  const Plane board_W = boardPlane(state.T_W_B);
  const double floor2 = params_.noise_floor_m * params_.noise_floor_m;
  const double range2 = range_sigma_m_ * range_sigma_m_;
  const std::uint32_t stride = strideFor(scan->raw->points.size(), points);
  const auto addBin = [&](TimeNs stamp, int node, const TimedSensorPose& pose, const auto& point, const auto& forEach) {
    Bin bin;
    bin.stamp = stamp;
    bin.node = node;
    const Eigen::Matrix3d R_W_L = pose.T_W_S.R();
    forEach([&](std::size_t index) {
      std::int16_t& label = scan->plane[index];
      if (label == kNone && !isChosen(index, stride)) return;
      const Eigen::Vector3d p_L = point(index);
      const Eigen::Vector3d arm_W = R_W_L * p_L;
      const Eigen::Vector3d p_W = arm_W + pose.T_W_S.t;
      const double per_range = 1.0 / p_L.norm();
      const Eigen::Vector3d ray_W = per_range * arm_W;
      const bool on_board = label == kOnBoard;
      scan->points_seen += !on_board;
      const int plane = on_board ? -1 : map.planeAt(p_W, ray_W);
      if (!on_board && (plane < 0 || plane >= static_cast<int>(state.planes.size()))) return;
      const Plane& plane_W = on_board ? board_W : state.planes[static_cast<std::size_t>(plane)];
      const double cosine = plane_W.normal.dot(ray_W);
      const double variance = range2 * cosine * cosine + floor2;  // range noise acts along the ray only
      const double distance = plane_W.distance(p_W);
      const double gate = params_.gate_sigmas * std::sqrt(variance) + slack_m;
      if (std::abs(distance) > gate) {
        label = kNone;
        return;
      }
      scan->addResidual(distance, cosine, floor2);
      PlanePoints* sums = &bin.board;
      if (on_board) {
        ++bin.board_points;
      } else {
        label = static_cast<std::int16_t>(plane);
        auto entry =
            std::find_if(bin.planes.begin(), bin.planes.end(), [&](const auto& e) { return e.first == plane; });
        if (entry == bin.planes.end()) entry = bin.planes.insert(entry, {plane, PlanePoints()});
        sums = &entry->second;
        scan->square_m2 += distance * distance;
        ++scan->points;
      }
      addPoint(p_L, per_range * p_L, range2, variance / *scan->weight, sums);
    });
    if (!bin.planes.empty() || bin.board_points > 0) scan->bins.push_back(std::move(bin));
  };
  forEachBin(state, chain, *scan, addBin);
}

void LidarGroup::linkEdges(const WindowState& state, const InertialChain& chain, const BoardSegment& board,
                           Scan* scan) const {
  // The edge lies evenly anywhere between two beams: standard deviation a 1/sqrt(12) of their distance, plus footprint.
  constexpr double kUniform = 0.2887, kFootprint = 0.002;
  for (const BoardEdgeCrossing& crossing : board.crossings) {
    const LidarPoint& on = scan->raw->points[static_cast<std::size_t>(crossing.on_index)];
    const double range = on.p.norm();
    const Eigen::Vector3d on_bearing = on.p.cast<double>() / range;
    const Eigen::Vector3d beyond = crossing.beyond_bearing_L.cast<double>();
    Edge edge;
    edge.stamp = scan->raw->stamp + toNs(0.5 * (on.offset_s + crossing.beyond_offset_s));
    edge.node = lidarNode(state, edge.stamp);
    edge.bearing_L = (on_bearing + beyond).normalized();
    const Pose T_B_L = state.T_W_B.inverse() * lidarPose(state, chain, edge.node, edge.stamp).T_W_S;
    const Eigen::Vector3d hit_B = T_B_L * (range * edge.bearing_L);
    const Eigen::Vector3d gap_B = T_B_L.q * (range * (beyond - on_bearing));
    edge.outline = edgeCrossed(hit_B, gap_B, state.outline);
    if (edge.outline < 0) continue;
    edge.sigma_m = std::hypot(kUniform * gap_B[edge.outline / 2], kFootprint);
    edge.weight = *scan->weight;
    scan->edges.push_back(edge);
  }
}

std::vector<Eigen::Vector3f> deskewToWorld(const LidarScan& scan, const WindowState& state,
                                           const InertialChain& chain) {
  constexpr double kStep = 0.002;
  std::vector<Eigen::Vector3f> points_W(scan.points.size());
  int bin = -1;
  TimedSensorPose pose;
  Eigen::Vector3d v_L;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const LidarPoint& raw = scan.points[i];
    const int own = static_cast<int>(raw.offset_s / kStep);
    const double middle_s = (own + 0.5) * kStep;
    if (own != bin) {
      const TimeNs stamp = scan.stamp + toNs(middle_s);
      pose = lidarPose(state, chain, lidarNode(state, stamp), stamp);
      v_L = pose.T_W_S.q.conjugate() * pose.v_W;
      bin = own;
    }
    points_W[i] = (pose.T_W_S * deskew(raw.p, raw.offset_s - middle_s, v_L, pose.w_S)).cast<float>();
  }
  return points_W;
}

}  // namespace cocalib
