#include "cocalib/lidar/board_segmenter.h"

#include <algorithm>
#include <cmath>

#include "cocalib/lidar/board_outline.h"
#include "cocalib/lidar/board_patch.h"

namespace cocalib {
namespace {

constexpr int kMaxPlanes = 3;  // the plate, and what else may stand within the gate
constexpr int kRansacIterations = 120;
constexpr double kGateSigmas = 3.0;
constexpr double kMinGate_m = 0.05;  // the plate's size and centring are not perfect either

/// Where the plate may be, around its predicted pose.
struct Gate {
  Pose T_L_P;  ///< predicted pose of the plate: origin in its middle, axes of B
  double in_plane_m, along_normal_m, normal_angle_rad, roll_rad;
};

Gate predictedGate(const Pose& T_L_B, const BoardGeometry& board, double range_noise_m, double tolerance_m,
                   double tolerance_rad) {
  Gate gate;
  gate.T_L_P = T_L_B * Pose{Eigen::Quaterniond::Identity(), plateCentre(board)};
  const double half_diagonal = 0.5 * plateSize(board).norm();
  gate.in_plane_m = kMinGate_m + kGateSigmas * tolerance_m;
  gate.along_normal_m = gate.in_plane_m + kGateSigmas * (range_noise_m + tolerance_rad * half_diagonal);
  // The fit's own tilt error: noise over a plate's extent is under 0.05 rad where 20 points lie on it.
  gate.normal_angle_rad = 0.05 + kGateSigmas * tolerance_rad;
  gate.roll_rad = 0.1 + kGateSigmas * tolerance_rad;
  return gate;
}

std::vector<int> pointsInGate(const plate::Sweep& sweep, const Gate& gate, const Eigen::Vector2d& half_size) {
  const Pose T_P_L = gate.T_L_P.inverse();
  std::vector<int> indices;
  for (int i = 0; i < static_cast<int>(sweep.points_L.size()); ++i) {
    const Eigen::Vector3d q = T_P_L * sweep.point(i);
    if (std::abs(q.x()) < half_size.x() + gate.in_plane_m && std::abs(q.y()) < half_size.y() + gate.in_plane_m &&
        std::abs(q.z()) < gate.along_normal_m) {
      indices.push_back(i);
    }
  }
  return indices;
}

bool agreesWithPrediction(const plate::Patch& patch, const Gate& gate) {
  const Eigen::Vector3d offset = gate.T_L_P.inverse() * patch.frame.point(patch.rectangle.centre);
  if (offset.head<2>().norm() > gate.in_plane_m || std::abs(offset.z()) > gate.along_normal_m) return false;
  const Eigen::Vector3d side =
      std::cos(patch.rectangle.angle_rad) * patch.frame.u + std::sin(patch.rectangle.angle_rad) * patch.frame.v;
  return std::abs(side.dot(gate.T_L_P.q * Eigen::Vector3d::UnitX())) > std::cos(std::min(gate.roll_rad, 1.5));
}

Eigen::Vector3d meanOf(const plate::Sweep& sweep, const std::vector<int>& indices) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const int i : indices) sum += sweep.point(i);
  return sum / static_cast<double>(indices.size());
}

/// All returns from the plate, those at its rim too, in ascending order.
std::vector<int> returnsFrom(const plate::Patch& patch) {
  std::vector<int> indices;
  for (const plate::Row& row : patch.rows) {
    for (const plate::Beam& beam : row.beams) {
      const bool on = beam.verdict == plate::Verdict::kOn || beam.verdict == plate::Verdict::kUnclear;
      if (on && patch.rectangle.signedDistance(beam.hit) < 0.05) indices.push_back(beam.index);
    }
  }
  std::sort(indices.begin(), indices.end());
  return indices;
}

void removeSorted(const std::vector<int>& sorted_remove, std::vector<int>* indices) {
  indices->erase(
      std::remove_if(indices->begin(), indices->end(),
                     [&](int i) { return std::binary_search(sorted_remove.begin(), sorted_remove.end(), i); }),
      indices->end());
}

}  // namespace

std::optional<BoardSegment> segmentBoard(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                                         const Pose& T_L_B, const BoardGeometry& board, double range_noise_m,
                                         double tolerance_m, double tolerance_rad) {
  if (points_L.size() != scan.points.size()) return std::nullopt;
  const plate::Sweep sweep{scan, points_L, range_noise_m};
  const Eigen::Vector2d size = plateSize(board);
  const Gate gate = predictedGate(T_L_B, board, range_noise_m, tolerance_m, tolerance_rad);
  // Whichever side of it the lidar sees: normals here point away from the lidar.
  Eigen::Vector3d normal = gate.T_L_P.q * Eigen::Vector3d::UnitZ();
  if (normal.dot(gate.T_L_P.t) < 0.0) normal = -normal;
  const Eigen::Vector3d side = gate.T_L_P.q * Eigen::Vector3d::UnitX();

  std::vector<int> left = pointsInGate(sweep, gate, 0.5 * size);
  std::optional<plate::Patch> found;
  for (int k = 0; k < kMaxPlanes; ++k) {
    std::vector<int> supporters;
    const auto plane = plate::findPlane(sweep, left, normal, gate.normal_angle_rad, kRansacIterations, &supporters);
    if (!plane) break;
    const Eigen::Vector3d start = found ? meanOf(sweep, supporters) : gate.T_L_P.t;
    const auto patch = plate::fitPatch(sweep, *plane, supporters, start, side, size, false);
    if (!patch || !agreesWithPrediction(*patch, gate)) {
      removeSorted(supporters, &left);
      continue;
    }
    // Two plates: which one is the board cannot be told.
    const Eigen::Vector3d centre = patch->frame.point(patch->rectangle.centre);
    if (found && (centre - found->frame.point(found->rectangle.centre)).norm() > 0.3 * size.minCoeff()) {
      return std::nullopt;
    }
    if (!found) found = patch;
    removeSorted(returnsFrom(*patch), &left);
  }
  if (!found) return std::nullopt;
  return plate::segmentOf(sweep, *found);
}

}  // namespace cocalib
