#include "cocalib/lidar/board_outline.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

namespace cocalib::plate {
namespace {

constexpr double kNextBeam = 1.6;  // in steps: farther apart, a beam in between did not answer
constexpr double kRim_m = 0.02;
constexpr double kBeamDivergence_rad = 3e-3;  // full angle; VLP-16: 3.0 mrad, the widest of the usual sensors

/// One end of a row's stay on the plate, looking outwards.
struct RowEnd {
  const Beam* on;      ///< last beam on the plate
  const Beam* before;  ///< the one before it, on the plate too
  const Beam* beyond;  ///< next return outwards, or null
};

/// A row is swept in the order of its azimuths but for the seam between a sweep's end and its begin; other scan
/// patterns come back many times, and there the neighbour by azimuth is no neighbour.
bool sweptOnce(const Sweep& sweep, const std::vector<Beam>& beams) {
  int turns = 0;
  double direction = 0.0;
  for (std::size_t k = 1; k < beams.size(); ++k) {
    const double dt = sweep.raw(beams[k].index).offset_s - sweep.raw(beams[k - 1].index).offset_s;
    if (dt * direction < 0.0) ++turns;
    if (dt != 0.0) direction = dt;
  }
  return turns <= 2;  // into the seam's jump and out of it
}

std::optional<BoardEdgeCrossing> crossingAt(const Sweep& sweep, const Patch& patch, const RowEnd& end,
                                            double step_rad) {
  // A row may also end inside, at returns that got lost; that is no edge.
  if (patch.rectangle.signedDistance(end.on->hit) < -(kRim_m + 2.0 * patch.step_m)) return std::nullopt;
  const LidarPoint& on = sweep.raw(end.on->index);
  const LidarPoint& before = sweep.raw(end.before->index);
  const double spacing = std::abs(end.on->azimuth_rad - end.before->azimuth_rad);
  const double seam_s = 0.01;  // neighbours of one sweep pass are far closer, its begin and end far apart
  if (std::abs(on.offset_s - before.offset_s) > seam_s * std::max(1.0, spacing / step_rad)) return std::nullopt;

  BoardEdgeCrossing crossing;
  crossing.on_index = end.on->index;
  if (end.beyond != nullptr && std::abs(end.beyond->azimuth_rad - end.on->azimuth_rad) < kNextBeam * step_rad) {
    const LidarPoint& beyond = sweep.raw(end.beyond->index);
    const bool behind = end.beyond->verdict == Verdict::kOff || end.beyond->verdict == Verdict::kUnclear;
    if (!behind || std::abs(beyond.offset_s - on.offset_s) > seam_s) return std::nullopt;
    crossing.beyond_bearing_L = beyond.p.normalized();
    crossing.beyond_offset_s = beyond.offset_s;
    return crossing;
  }
  if (spacing < 0.2 * step_rad) return std::nullopt;
  const auto ahead = static_cast<float>(step_rad / spacing);
  const Eigen::Vector3f b = on.p.normalized();
  crossing.beyond_bearing_L = (b + ahead * (b - before.p.normalized())).normalized();
  crossing.beyond_offset_s = on.offset_s + ahead * (on.offset_s - before.offset_s);
  return crossing;
}

}  // namespace

std::vector<BoardEdgeCrossing> crossingsOf(const Sweep& sweep, const Patch& patch) {
  std::vector<BoardEdgeCrossing> crossings;
  const double step = azimuthStep(patch.rows);
  if (step <= 0.0) return crossings;
  float sweep_end = 0.0F;
  for (const LidarPoint& point : sweep.scan.points) sweep_end = std::max(sweep_end, point.offset_s);
  for (const Row& row : patch.rows) {
    if (row.ring < 0) continue;
    const auto onPlate = [&](const Beam& b) {
      return b.verdict == Verdict::kOn && patch.rectangle.signedDistance(b.hit) < kRim_m + patch.step_m;
    };
    const auto first = std::find_if(row.beams.begin(), row.beams.end(), onPlate);
    const auto past_last = std::find_if(row.beams.rbegin(), row.beams.rend(), onPlate).base();
    if (past_last - first < 3 || !sweptOnce(sweep, {first, past_last})) continue;
    const auto last = std::prev(past_last);
    const auto second = std::find_if(std::next(first), past_last, onPlate);
    auto last_but_one = std::prev(last);
    while (last_but_one != first && !onPlate(*last_but_one)) --last_but_one;
    for (const RowEnd& end : {RowEnd{&*first, &*second, first == row.beams.begin() ? nullptr : &*std::prev(first)},
                              RowEnd{&*last, &*last_but_one, past_last == row.beams.end() ? nullptr : &*past_last}}) {
      const auto crossing = crossingAt(sweep, patch, end, step);
      // Where time would leave the sweep the beam was never fired.
      if (crossing && crossing->beyond_offset_s >= 0.0F && crossing->beyond_offset_s <= sweep_end) {
        crossings.push_back(*crossing);
      }
    }
  }
  return crossings;
}

BoardSegment segmentOf(const Sweep& sweep, const Patch& patch) {
  BoardSegment segment;
  segment.plane_L = patch.frame.plane;
  const double range = patch.frame.point(patch.rectangle.centre).norm();
  const double rim = kRim_m + 0.5 * (kBeamDivergence_rad * range + patch.step_m);
  for (const Row& row : patch.rows) {
    for (const Beam& beam : row.beams) {
      if (beam.verdict != Verdict::kOn || patch.rectangle.signedDistance(beam.hit) > -rim) continue;
      segment.points.push_back(beam.index);
    }
  }
  std::sort(segment.points.begin(), segment.points.end());
  segment.crossings = crossingsOf(sweep, patch);
  return segment;
}

}  // namespace cocalib::plate
