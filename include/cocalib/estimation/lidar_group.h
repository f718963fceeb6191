#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/repeat_weight.h"
#include "cocalib/factors/point_factors.h"
#include "cocalib/factors/timed_sensor_pose.h"
#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/lidar/plane_map.h"

namespace cocalib {

/// The lidar factors of a window: points on plane landmarks, points on the board, crossings of its outline.
///
/// Raw points are kept. link() gives every point its plane and sums the points of each few milliseconds and plane into
/// one 4x4 moment in the lidar frame; within that time the points are brought to its middle with the current
/// estimate, where an error of the calibration is of second order. accumulate() then costs the same for 500 points
/// as for 50,000.
class LidarGroup {
 public:
  struct Params {
    double range_noise_m = 0.03;   ///< at the start; see learnRangeNoise()
    double noise_floor_m = 0.004;  ///< across the plane, whatever the incidence: bearing noise, roughness
    double gate_sigmas = 4.0;
    double bin_s = 0.004;  ///< points of this long share one pose; within it rates count as constant
    std::optional<BoardGeometry> board;
  };
  static constexpr std::size_t kLivePoints = 12000, kAllPoints = 0;  ///< of each scan, for link()

  explicit LidarGroup(const Params& params) : params_(params), range_sigma_m_(params.range_noise_m) {}

  void addScan(std::shared_ptr<const LidarScan> scan);
  int scans() const { return static_cast<int>(scans_.size()); }

  /// Adds the deskewed points of the scans from `first_scan` on to `map` (one in `stride`), without those on the
  /// board.
  void fillMap(const WindowState& state, const InertialChain& chain, int first_scan, std::uint32_t stride,
               PlaneMap* map) const;

  /// Associates the points of the scans from `first_scan` on anew. `map` numbers planes as `state.planes` does.
  /// @param slack_m  uncertainty of the current estimate, added to the gate
  /// @param points   of each scan, about; kAllPoints: every one. Those on the board are looked at in any case
  void link(const WindowState& state, const InertialChain& chain, const PlaneMap& map, int first_scan, double slack_m,
            bool board_known, std::size_t points);

  /// Adds all factors; or, with `end_node` >= 0, only those of nodes before it.
  void accumulate(const WindowState& state, const InertialChain& chain, int end_node, ChainSystem* system) const;

  /// Takes over where another group has found the board in the scans that both hold.
  void adoptBoards(const LidarGroup& other);

  /// Sets the noise of ranges to what the residuals of the last link() show; the next link() weighs with it.
  void learnRangeNoise();
  double rangeSigma() const { return range_sigma_m_; }

  /// Forgets everything that accumulate(.., end_node, ..) used, and renumbers the nodes. A sweep that was under way
  /// at that time goes on from there.
  /// @param from  stamp of that node on the lidar's clock
  void dropFront(int end_node, TimeNs from);

  /// Which of the first `count` planes any point was linked to.
  std::vector<bool> planesInUse(std::size_t count) const;
  /// Share of the points looked at by link() that lie on a plane, over the scans first..end-1.
  double shareOnPlanes(int first, int end) const;
  /// RMS distance of the linked points to their planes [m], and how many there are.
  double planeRms() const;
  std::size_t linkedPoints() const;
  int boardPoints() const;
  const LidarScan& scan(int index) const { return *scans_[static_cast<std::size_t>(index)].raw; }
  /// Plane of every point of a scan at the last link(), -1: none.
  const std::vector<std::int16_t>& planesOf(int index) const { return scans_[static_cast<std::size_t>(index)].plane; }

 private:
  struct Bin {
    TimeNs stamp = 0;  // lidar clock, middle
    int node = -1;
    std::vector<std::pair<int, PlanePoints>> planes;  // in order of plane number
    PlanePoints board;
    int board_points = 0;
  };
  struct Edge {
    TimeNs stamp = 0;
    int node = -1;
    Eigen::Vector3d bearing_L;
    int outline = 0;  // index in WindowState::outline
    double sigma_m = 0.0;
    double weight = 1.0;
  };
  struct Scan {
    std::shared_ptr<const LidarScan> raw;
    TimeNs from = 0;               // bins before it have been dropped; lidar clock
    std::optional<double> weight;  // see RepeatWeight; set by the first link()
    std::vector<Bin> bins;
    std::vector<Edge> edges;
    std::vector<std::int16_t> plane;
    std::optional<BoardSegment> board;
    double searched_m = std::numeric_limits<double>::infinity();  // how well the board was predicted when looked for
    double square_m2 = 0.0;
    std::size_t points = 0, points_seen = 0;  // of distances to planes; and those looked at for it
    double range_square_m2 = 0.0;             // of distances along the ray, board included
    std::size_t range_points = 0;

    void addResidual(double distance_m, double cosine, double floor2);
  };

  /// Gives every scan that has none its weight, in their order.
  void weighRepeats(const WindowState& state, const InertialChain& chain);
  template <typename Visit>
  void forEachBin(const WindowState& state, const InertialChain& chain, const Scan& scan, Visit&& visit) const;
  /// Finds the board in a scan, unless it was looked for before with as good a prediction.
  void findBoard(const WindowState& state, const InertialChain& chain, double slack_m, Scan* whole) const;
  void linkScan(const WindowState& state, const InertialChain& chain, const PlaneMap& map, double slack_m,
                std::size_t points, Scan* scan) const;
  void linkEdges(const WindowState& state, const InertialChain& chain, const BoardSegment& board, Scan* scan) const;
  void accumulateBin(const WindowState& state, const InertialChain& chain, const Bin& bin,
                     const std::vector<Eigen::Matrix<double, 4, 3>>& tangents, ChainSystem* system) const;
  void accumulateEdge(const WindowState& state, const InertialChain& chain, const Edge& edge,
                      ChainSystem* system) const;

  Params params_;
  double range_sigma_m_;
  std::vector<Scan> scans_;
  RepeatWeight repeats_;
};

/// Brings every point of a sweep to the world with the current estimate, each at its own time.
std::vector<Eigen::Vector3f> deskewToWorld(const LidarScan& scan, const WindowState& state, const InertialChain& chain);

}  // namespace cocalib
