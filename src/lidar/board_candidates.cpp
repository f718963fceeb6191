#include <algorithm>
#include <cmath>
#include <vector>

#include "cocalib/lidar/board_outline.h"
#include "cocalib/lidar/board_patch.h"
#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/lidar/voxel_index.h"

namespace cocalib {
namespace {

constexpr int kMinSeedPoints = 5;
constexpr int kMinPatchPoints = 20;
constexpr int kRansacIterations = 40;
constexpr int kShifts = 6;            // from a corner of the plate to its middle
constexpr double kReach = 0.6;        // of the diagonal: a circle that holds the whole plate and a bit more
constexpr double kSurround = 0.85;    // of the diagonal: outer radius of the surround
constexpr double kMaxSurround = 0.5;  // points per area in the surround, against the circle: 1 within a wall
constexpr double kFewPoints = 30.0;   // at so many the score is halved: chance fits them too
constexpr std::size_t kMaxCandidates = 8;

/// Points by cubic cells, to gather those near a place.
class Neighbours {
 public:
  Neighbours(const plate::Sweep& sweep, double cell_m) : sweep_(sweep), inverse_edge_(1.0 / cell_m) {
    for (int i = 0; i < static_cast<int>(sweep.points_L.size()); ++i) {
      const Eigen::Vector3d p = sweep.point(i);
      if (!voxelInRange(p, inverse_edge_)) continue;
      const auto number = static_cast<std::size_t>(index_.findOrInsert(voxelOf(p, inverse_edge_)));
      if (number == cells_.size()) cells_.emplace_back();
      cells_[number].push_back(i);
    }
  }

  const std::vector<std::vector<int>>& cells() const { return cells_; }

  std::vector<int> within(const Eigen::Vector3d& centre, double radius_m) const {
    std::vector<int> found;
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(radius_m);
    const Voxel low = voxelOf(centre - reach, inverse_edge_), high = voxelOf(centre + reach, inverse_edge_);
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int z = low.z(); z <= high.z(); ++z) {
          const int number = index_.find({x, y, z});
          if (number < 0) continue;
          for (const int i : cells_[static_cast<std::size_t>(number)]) {
            if ((sweep_.point(i) - centre).squaredNorm() < radius_m * radius_m) found.push_back(i);
          }
        }
      }
    }
    return found;
  }

 private:
  const plate::Sweep& sweep_;
  double inverse_edge_;
  VoxelIndex index_;
  std::vector<std::vector<int>> cells_;
};

Eigen::Vector3d meanOf(const plate::Sweep& sweep, const std::vector<int>& indices) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const int i : indices) sum += sweep.point(i);
  return sum / static_cast<double>(indices.size());
}

/// A flat piece of about the plate's size around which its plane is empty.
struct Island {
  Plane plane;
  Eigen::Vector3d centre;
  std::vector<int> members;
};

/// Follows the flat piece at `seed` to its middle: plane and centre of the points within a plate-sized circle, in turn.
std::optional<Island> growIsland(const plate::Sweep& sweep, const Neighbours& neighbours, const Eigen::Vector3d& seed,
                                 const Eigen::Vector2d& size) {
  const double diagonal = size.norm();
  const double seed_radius = 0.5 * size.minCoeff();
  std::vector<int> members;
  const auto start = plate::findPlane(sweep, neighbours.within(seed, seed_radius), seed.normalized(), 1.45,
                                      kRansacIterations, &members);
  if (!start || members.size() < kMinPatchPoints / 2) return std::nullopt;
  Island island{*start, meanOf(sweep, members), members};
  for (int shift = 0; shift < kShifts; ++shift) {
    std::vector<int> inside;
    int surround = 0;
    for (const int i : neighbours.within(island.centre, kSurround * diagonal)) {
      const Eigen::Vector3d p = sweep.point(i);
      if (std::abs(island.plane.distance(p)) > sweep.onGate()) continue;
      if ((p - island.centre).norm() < kReach * diagonal) {
        inside.push_back(i);
      } else {
        ++surround;
      }
    }
    if (inside.size() < kMinPatchPoints) return std::nullopt;
    const auto plane = plate::fitPlane(sweep, inside);
    if (!plane) return std::nullopt;
    const Eigen::Vector3d centre = meanOf(sweep, inside);
    const double moved = (centre - island.centre).norm();
    island = {*plane, centre, inside};
    const bool settled = moved < 0.02 * diagonal;
    const double area_ratio = (kSurround * kSurround - kReach * kReach) / (kReach * kReach);
    const bool free_standing = surround < kMaxSurround * area_ratio * static_cast<double>(inside.size());
    if (settled || shift + 1 == kShifts) return free_standing ? std::optional<Island>(island) : std::nullopt;
  }
  return std::nullopt;
}

BoardCandidate candidateFrom(const plate::Sweep& sweep, const plate::Patch& patch) {
  BoardCandidate candidate;
  candidate.segment = plate::segmentOf(sweep, patch);
  candidate.centre_L = patch.frame.point(patch.rectangle.centre);
  candidate.normal_L = patch.frame.plane.normal;
  candidate.centre_L -= patch.frame.plane.distance(candidate.centre_L) * candidate.normal_L;
  candidate.extent_m = 2.0 * plate::measureRectangle(patch).half_m;
  const Eigen::Vector2d half = patch.rectangle.half_m;
  const Eigen::Vector2d nominal(2.0 * half.maxCoeff(), 2.0 * half.minCoeff());
  const double size_error = (candidate.extent_m - nominal).cwiseAbs().cwiseQuotient(nominal).maxCoeff();
  const auto points = static_cast<double>(patch.members.size());
  candidate.score =
      std::max(0.0, 1.0 - patch.misfit) * std::max(0.0, 1.0 - size_error) * points / (points + kFewPoints);
  return candidate;
}

/// Adds a candidate unless a better one stands there; replaces a worse one.
void addDistinct(const BoardCandidate& candidate, double min_distance_m, std::vector<BoardCandidate>* candidates) {
  for (BoardCandidate& other : *candidates) {
    if ((other.centre_L - candidate.centre_L).norm() > min_distance_m) continue;
    if (candidate.score > other.score) other = candidate;
    return;
  }
  candidates->push_back(candidate);
}

}  // namespace

std::vector<BoardCandidate> findBoardCandidates(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                                                const BoardGeometry& board, double range_noise_m) {
  std::vector<BoardCandidate> candidates;
  if (points_L.size() != scan.points.size()) return candidates;
  const plate::Sweep sweep{scan, points_L, range_noise_m};
  const Eigen::Vector2d size = plateSize(board);
  const Neighbours neighbours(sweep, 0.5 * size.minCoeff());
  std::vector<Eigen::Vector3d> looked_at;  // middles of the islands: many seeds lead to the same
  for (const std::vector<int>& cell : neighbours.cells()) {
    if (cell.size() < kMinSeedPoints) continue;
    const auto island = growIsland(sweep, neighbours, meanOf(sweep, cell), size);
    if (!island) continue;
    const bool known = std::any_of(looked_at.begin(), looked_at.end(), [&](const Eigen::Vector3d& centre) {
      return (centre - island->centre).norm() < 0.1 * size.minCoeff();
    });
    if (known) continue;
    looked_at.push_back(island->centre);
    const auto patch =
        plate::fitPatch(sweep, island->plane, island->members, island->centre, Eigen::Vector3d::UnitZ(), size, true);
    if (patch) addDistinct(candidateFrom(sweep, *patch), 0.5 * size.minCoeff(), &candidates);
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const BoardCandidate& a, const BoardCandidate& b) { return a.score > b.score; });
  if (candidates.size() > kMaxCandidates) candidates.resize(kMaxCandidates);
  return candidates;
}

}  // namespace cocalib
