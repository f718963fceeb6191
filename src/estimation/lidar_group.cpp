#include "cocalib/estimation/lidar_group.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "cocalib/estimation/pose_scatter.h"
#include "cocalib/factors/point_factors.h"
#include "cocalib/factors/robust.h"
#include "lidar_pose.h"

namespace cocalib {

void LidarGroup::addScan(std::shared_ptr<const LidarScan> scan) {
  scans_.emplace_back();
  scans_.back().raw = std::move(scan);
}

void LidarGroup::adoptBoards(const LidarGroup& other) {
  std::map<const LidarScan*, const Scan*> theirs;
  for (const Scan& scan : other.scans_) theirs.emplace(scan.raw.get(), &scan);
  for (Scan& scan : scans_) {
    const auto same = theirs.find(scan.raw.get());
    if (same == theirs.end() || same->second->searched_m >= scan.searched_m) continue;
    scan.board = same->second->board;
    scan.searched_m = same->second->searched_m;
  }
}

void LidarGroup::accumulate(const WindowState& state, const InertialChain& chain, int end_node,
                            ChainSystem* system) const {
  std::vector<Eigen::Matrix<double, 4, 3>> tangents;
  tangents.reserve(state.planes.size());
  for (const Plane& plane : state.planes) tangents.push_back(planeTangent(plane));
  for (const Scan& scan : scans_) {
    for (const Bin& bin : scan.bins) {
      if (end_node < 0 || bin.node < end_node) accumulateBin(state, chain, bin, tangents, system);
    }
    for (const Edge& edge : scan.edges) {
      if (end_node < 0 || edge.node < end_node) accumulateEdge(state, chain, edge, system);
    }
  }
}

void LidarGroup::accumulateBin(const WindowState& state, const InertialChain& chain, const Bin& bin,
                               const std::vector<Eigen::Matrix<double, 4, 3>>& tangents, ChainSystem* system) const {
  constexpr int kL = GlobalLayout::kLidar, kB = GlobalLayout::kBoard;
  const TimedSensorPose pose = lidarPose(state, chain, bin.node, bin.stamp);
  Matrix6d H = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  for (const auto& [index, points] : bin.planes) {
    const PlaneMomentResidual f = planeMoment(pose.T_W_S, state.planes[static_cast<std::size_t>(index)], points);
    const Eigen::Matrix<double, 4, 3> J_plane = f.J_plane * tangents[static_cast<std::size_t>(index)];
    const Eigen::Matrix<double, 4, 3> S_J = points.moment * J_plane;
    const int column = GlobalLayout::plane(index);
    H += f.H_pose;
    b += f.b_pose;
    scatterPoseGlobal<3>(pose, bin.node, kL, f.J_pose.transpose() * S_J, column, system);
    system->H_global.block<3, 3>(column, column).noalias() += J_plane.transpose() * S_J;
    system->b_global.segment<3>(column).noalias() += J_plane.transpose() * f.S_pi;
    system->cost += f.cost;
  }
  if (bin.board_points > 0) {
    const PlaneMomentResidual f = planeMoment(pose.T_W_S, boardPlane(state.T_W_B), bin.board);
    const Eigen::Matrix<double, 4, 6> J_board = f.J_plane * boardPlaneTangent(state.T_W_B);
    const Eigen::Matrix<double, 4, 6> S_J = bin.board.moment * J_board;
    H += f.H_pose;
    b += f.b_pose;
    scatterPoseGlobal<6>(pose, bin.node, kL, f.J_pose.transpose() * S_J, kB, system);
    system->H_global.block<6, 6>(kB, kB).noalias() += J_board.transpose() * S_J;
    system->b_global.segment<6>(kB).noalias() += J_board.transpose() * f.S_pi;
    system->cost += f.cost;
  }
  scatterPose(pose, bin.node, kL, H, b, system);
}

void LidarGroup::accumulateEdge(const WindowState& state, const InertialChain& chain, const Edge& edge,
                                ChainSystem* system) const {
  constexpr int kL = GlobalLayout::kLidar, kB = GlobalLayout::kBoard;
  const TimedSensorPose pose = lidarPose(state, chain, edge.node, edge.stamp);
  const auto f =
      boardEdge(pose.T_W_S, state.T_W_B, edge.bearing_L, edge.outline / 2, state.outline[edge.outline], edge.sigma_m);
  if (!f) return;
  // A crossing beside a wrong neighbour (a ring's first point, a thin obstacle) must not pull.
  const RobustWeight robust = huber(f->r * f->r, 2.0);
  const int e = GlobalLayout::kOutline + edge.outline;
  Eigen::Matrix<double, 1, 7> J_globals;  // board pose, then this edge
  J_globals << f->J_board, f->J_edge;
  const double weight = edge.weight * robust.weight;
  const Vector6d wJ = weight * f->J_pose.transpose();
  scatterPose(pose, edge.node, kL, wJ * f->J_pose, wJ * f->r, system);
  scatterPoseGlobal<6>(pose, edge.node, kL, wJ * f->J_board, kB, system);
  scatterPoseGlobal<1>(pose, edge.node, kL, wJ * f->J_edge, e, system);
  const Eigen::Matrix<double, 7, 7> H = weight * J_globals.transpose() * J_globals;
  system->H_global.block<6, 6>(kB, kB) += H.topLeftCorner<6, 6>();
  system->H_global.block<6, 1>(kB, e) += H.topRightCorner<6, 1>();
  system->H_global.block<1, 6>(e, kB) += H.bottomLeftCorner<1, 6>();
  system->H_global(e, e) += H(6, 6);
  system->b_global.segment<6>(kB) += weight * f->r * f->J_board.transpose();
  system->b_global[e] += weight * f->r * f->J_edge;
  system->cost += edge.weight * robust.cost;
}

void LidarGroup::dropFront(int end_node, TimeNs from) {
  const auto isOver = [&](const Scan& scan) {
    return scan.raw->points.empty() || scan.raw->stamp + toNs(scan.raw->points.back().offset_s) < from;
  };
  scans_.erase(scans_.begin(), std::find_if_not(scans_.begin(), scans_.end(), isOver));
  for (Scan& scan : scans_) {
    if (scan.raw->stamp < from) scan.from = std::max(scan.from, from);
    // The clock offset may have moved since the nodes were found: what was used must not come back.
    for (const Bin& bin : scan.bins) {
      if (bin.node < end_node) scan.from = std::max(scan.from, bin.stamp + 1);
    }
    const auto used = [&](const auto& entry) { return entry.node < end_node; };
    scan.bins.erase(std::remove_if(scan.bins.begin(), scan.bins.end(), used), scan.bins.end());
    scan.edges.erase(std::remove_if(scan.edges.begin(), scan.edges.end(), used), scan.edges.end());
    for (Bin& bin : scan.bins) bin.node -= end_node;
    for (Edge& edge : scan.edges) edge.node -= end_node;
  }
}

std::vector<bool> LidarGroup::planesInUse(std::size_t count) const {
  std::vector<bool> used(count, false);
  for (const Scan& scan : scans_) {
    for (const Bin& bin : scan.bins) {
      for (const auto& entry : bin.planes) used[static_cast<std::size_t>(entry.first)] = true;
    }
  }
  return used;
}

double LidarGroup::shareOnPlanes(int first, int end) const {
  std::size_t on_planes = 0, seen = 0;
  for (int i = first; i < end; ++i) {
    on_planes += scans_[static_cast<std::size_t>(i)].points;
    seen += scans_[static_cast<std::size_t>(i)].points_seen;
  }
  return seen > 0 ? static_cast<double>(on_planes) / static_cast<double>(seen) : 0.0;
}

double LidarGroup::planeRms() const {
  double square = 0.0;
  for (const Scan& scan : scans_) square += scan.square_m2;
  const std::size_t points = linkedPoints();
  return points > 0 ? std::sqrt(square / static_cast<double>(points)) : 0.0;
}

void LidarGroup::Scan::addResidual(double distance_m, double cosine, double floor2) {
  constexpr double kMinCosine = 0.3;  // at flatter incidence the floor has too large a part
  if (std::abs(cosine) < kMinCosine) return;
  range_square_m2 += (distance_m * distance_m - floor2) / (cosine * cosine);
  ++range_points;
}

void LidarGroup::learnRangeNoise() {
  constexpr std::size_t kMinPoints = 1000;
  constexpr double kMinShare = 0.2, kMaxShare = 2.0;  // of what the rig file says
  double square = 0.0;
  std::size_t points = 0;
  for (const Scan& scan : scans_) {
    square += scan.range_square_m2;
    points += scan.range_points;
  }
  if (points < kMinPoints) return;
  const double learnt = std::sqrt(std::max(0.0, square / static_cast<double>(points)));
  range_sigma_m_ = std::clamp(learnt, kMinShare * params_.range_noise_m, kMaxShare * params_.range_noise_m);
}

std::size_t LidarGroup::linkedPoints() const {
  std::size_t points = 0;
  for (const Scan& scan : scans_) points += scan.points;
  return points;
}

int LidarGroup::boardPoints() const {
  int points = 0;
  for (const Scan& scan : scans_) {
    for (const Bin& bin : scan.bins) points += bin.board_points;
  }
  return points;
}

}  // namespace cocalib
