#include "cocalib/lidar/board_patch.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cocalib::plate {
namespace {

constexpr double kSurround_m = 0.25;     // looked at beyond the plate's corners
constexpr double kCoarseScale_m = 0.06;  // transition of the outline while its pose is searched,
constexpr double kFineScale_m = 0.02;    // and at last: about the spacing of beams at 3 m
constexpr int kRollStarts = 12;          // every 15 degrees
constexpr int kRefinedStarts = 3;
constexpr std::size_t kSearchPoints = 150;  // of each kind, for the search
constexpr int kMinMembers = 20;
constexpr int kMinRows = 2;              // rings on the plate
constexpr int kMinRowsUnpredicted = 3;   // fewer fit anything
constexpr double kMinPart = 0.5;         // of either side, in the field of view
constexpr double kSizeTolerance = 0.12;  // of a side's length
constexpr double kRim_m = 0.02;          // beams this near the outline do not count for or against
constexpr double kBand_m = 0.12;         // width of the surround that must be empty
constexpr double kMaxHoles = 0.15;       // share of beams through the plate
constexpr double kMaxBlocked = 0.5;      // share of beams stopped before it
constexpr double kMaxContinued = 0.35;   // share of beams in the surround that lie on the plane (a stand, a hand)
constexpr double kSideContinued = 0.6;   // the same of one side, to call the side continued

struct Evidence {
  std::vector<Eigen::Vector2d> on, off;
};

Evidence evidenceOf(const std::vector<Row>& rows) {
  Evidence evidence;
  for (const Row& row : rows) {
    for (const Beam& beam : row.beams) {
      if (beam.verdict == Verdict::kOn) evidence.on.push_back(beam.hit);
      if (beam.verdict == Verdict::kOff) evidence.off.push_back(beam.hit);
    }
  }
  return evidence;
}

/// Where a row's returns end and no beam answers, the next beam found nothing: that is evidence too.
void addMissing(const std::vector<Row>& rows, const Rectangle& rectangle, double step_rad, Evidence* evidence) {
  for (const Row& row : rows) {
    const auto& beams = row.beams;
    const auto onPlate = [&](const Beam& b) {
      return b.verdict == Verdict::kOn && rectangle.signedDistance(b.hit) < 2.0 * kRim_m;
    };
    const auto first = std::find_if(beams.begin(), beams.end(), onPlate);
    const auto last = std::find_if(beams.rbegin(), beams.rend(), onPlate);
    if (row.ring < 0 || first == beams.end() || &*first == &*last) continue;
    const Eigen::Vector2d per_rad = (last->hit - first->hit) / (last->azimuth_rad - first->azimuth_rad);
    const double reach = 1.6 * step_rad;
    if (first == beams.begin() || first->azimuth_rad - std::prev(first)->azimuth_rad > reach) {
      evidence->off.push_back(first->hit - per_rad * step_rad);
    }
    if (last == beams.rbegin() || std::prev(last)->azimuth_rad - last->azimuth_rad > reach) {
      evidence->off.push_back(last->hit + per_rad * step_rad);
    }
  }
}

/// Median distance between neighbouring rings where they pass the patch's middle.
double ringGap(const Sweep& sweep, const std::vector<Row>& rows) {
  std::vector<std::pair<double, Eigen::Vector2d>> middles;  // by elevation: drivers number rings in many ways
  for (const Row& row : rows) {
    if (row.ring < 0 || row.beams.empty()) continue;
    const auto nearest = std::min_element(row.beams.begin(), row.beams.end(), [](const Beam& a, const Beam& b) {
      return std::abs(a.azimuth_rad) < std::abs(b.azimuth_rad);
    });
    const Eigen::Vector3f& p = sweep.raw(nearest->index).p;
    middles.emplace_back(std::atan2(p.z(), std::hypot(p.x(), p.y())), nearest->hit);
  }
  std::sort(middles.begin(), middles.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<double> gaps;
  for (std::size_t k = 1; k < middles.size(); ++k) gaps.push_back((middles[k].second - middles[k - 1].second).norm());
  if (gaps.empty()) return 0.0;
  std::sort(gaps.begin(), gaps.end());
  return gaps[gaps.size() / 2];
}

/// Every so-many-th point: enough to find the roll.
std::vector<Eigen::Vector2d> thinned(const std::vector<Eigen::Vector2d>& points, std::size_t wanted) {
  const std::size_t stride = std::max<std::size_t>(1, points.size() / wanted);
  std::vector<Eigen::Vector2d> kept;
  for (std::size_t i = 0; i < points.size(); i += stride) kept.push_back(points[i]);
  return kept;
}

/// Only the points that bear on the outline's place: near it, or on its wrong side.
Evidence nearOutline(const Evidence& evidence, const Rectangle& rectangle) {
  const double reach = 10.0 * kFineScale_m;
  Evidence near;
  for (const auto& p : evidence.on) {
    if (rectangle.signedDistance(p) > -reach) near.on.push_back(p);
  }
  for (const auto& p : evidence.off) {
    if (rectangle.signedDistance(p) < reach) near.off.push_back(p);
  }
  return near;
}

/// Cheap look before the fit: the circle inside any plate here is filled, the one around it mostly empty.
bool mayHoldPlate(const Evidence& evidence, const Eigen::Vector2d& middle, const Eigen::Vector2d& size_m) {
  const double inner = 0.35 * size_m.minCoeff(), outer = 0.55 * size_m.norm();
  int on_inside = 0, off_inside = 0, on_outside = 0, off_outside = 0;
  for (const auto& p : evidence.on) {
    const double radius = (p - middle).norm();
    on_inside += radius < inner;
    on_outside += radius > outer;
  }
  for (const auto& p : evidence.off) {
    const double radius = (p - middle).norm();
    off_inside += radius < inner;
    off_outside += radius > outer;
  }
  return 2 * off_inside < on_inside && on_outside <= 0.7 * (on_outside + off_outside);
}

/// Best pose of the rectangle: from all directions of its first side, or from the given one only.
Rectangle placeRectangle(const Evidence& evidence, const Rectangle& start, bool any_roll) {
  std::vector<std::pair<double, Rectangle>> fits;
  const Evidence few{thinned(evidence.on, kSearchPoints), thinned(evidence.off, kSearchPoints)};
  for (int k = 0; k < (any_roll ? kRollStarts : 1); ++k) {
    Rectangle rectangle = start;
    rectangle.angle_rad += k * M_PI / kRollStarts;
    const double loss = fitRectangle(few.on, few.off, false, kCoarseScale_m, &rectangle);
    fits.emplace_back(loss, rectangle);
  }
  std::stable_sort(fits.begin(), fits.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  if (fits.size() > kRefinedStarts) fits.resize(kRefinedStarts);
  for (auto& [loss, rectangle] : fits) {
    loss = fitRectangle(few.on, few.off, false, kFineScale_m, &rectangle);
  }
  return std::min_element(fits.begin(), fits.end(), [](const auto& a, const auto& b) { return a.first < b.first; })
      ->second;
}

/// The rectangle with its size free too. One pair of points at each side of the known size holds a side about which no
/// beam says anything (nothing behind the plate answers); any real evidence outweighs it.
Rectangle fitSize(const Patch& patch) {
  Rectangle rectangle = patch.rectangle;
  Evidence evidence = evidenceOf(patch.rows);
  addMissing(patch.rows, rectangle, azimuthStep(patch.rows), &evidence);
  evidence = nearOutline(evidence, rectangle);
  const double c = std::cos(rectangle.angle_rad), s = std::sin(rectangle.angle_rad);
  const Eigen::Vector2d sides[2] = {{c, s}, {-s, c}};
  for (int axis = 0; axis < 2; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const Eigen::Vector2d edge = rectangle.centre + sign * rectangle.half_m[axis] * sides[axis];
      evidence.on.push_back(edge - sign * kFineScale_m * sides[axis]);
      evidence.off.push_back(edge + sign * kFineScale_m * sides[axis]);
    }
  }
  fitRectangle(evidence.on, evidence.off, true, kFineScale_m, &rectangle);
  return rectangle;
}

std::vector<int> membersOf(const std::vector<Row>& rows, const Rectangle& rectangle, double rim_m) {
  std::vector<int> members;
  for (const Row& row : rows) {
    for (const Beam& beam : row.beams) {
      if (beam.verdict == Verdict::kOn && rectangle.signedDistance(beam.hit) < -rim_m) members.push_back(beam.index);
    }
  }
  std::sort(members.begin(), members.end());
  return members;
}

struct Tally {
  int on_inside = 0, off_inside = 0, blocked_inside = 0;
  std::array<int, 4> on_beyond{}, off_beyond{};  // by side
};

Tally countBeams(const Patch& patch) {
  Tally tally;
  const double rim = std::max(kRim_m, patch.step_m);
  for (const Row& row : patch.rows) {
    for (const Beam& beam : row.beams) {
      const double distance = patch.rectangle.signedDistance(beam.hit);
      if (distance < -rim) {
        tally.on_inside += beam.verdict == Verdict::kOn;
        tally.off_inside += beam.verdict == Verdict::kOff;
        tally.blocked_inside += beam.verdict == Verdict::kBlocked;
      } else if (distance > 1.5 * rim && distance < 1.5 * rim + kBand_m) {
        const Eigen::Vector2d q = patch.rectangle.local(beam.hit);
        const bool first = std::abs(q.x()) - patch.rectangle.half_m.x() > std::abs(q.y()) - patch.rectangle.half_m.y();
        const std::size_t side = first ? (q.x() < 0.0 ? 0 : 1) : (q.y() < 0.0 ? 2 : 3);
        tally.on_beyond[side] += beam.verdict == Verdict::kOn;
        tally.off_beyond[side] += beam.verdict == Verdict::kOff;
      }
    }
  }
  return tally;
}

/// Whether the plate ends where the rectangle does, is filled, and how well; nothing: it is no such plate.
std::optional<double> judgeFit(const Patch& patch) {
  const Tally tally = countBeams(patch);
  if (tally.on_inside < kMinMembers) return std::nullopt;
  if (tally.off_inside > kMaxHoles * (tally.on_inside + tally.off_inside)) return std::nullopt;
  if (tally.blocked_inside > kMaxBlocked * (tally.on_inside + tally.blocked_inside)) return std::nullopt;
  int on = 0, off = 0, continued_sides = 0;
  for (std::size_t side = 0; side < 4; ++side) {
    on += tally.on_beyond[side];
    off += tally.off_beyond[side];
    const int decided = tally.on_beyond[side] + tally.off_beyond[side];
    if (decided > 3 && tally.on_beyond[side] > kSideContinued * decided) ++continued_sides;
  }
  if (continued_sides > 1 || on > kMaxContinued * (on + off)) return std::nullopt;
  return static_cast<double>(tally.off_inside + on) / tally.on_inside;
}

/// How the beams sample the plate.
struct Sampling {
  int rows = 0;                                                       ///< with at least 3 returns from the plate
  Eigen::Vector2d spacing_m = Eigen::Vector2d::Zero();                ///< of beams along the rectangle's sides
  Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9), high = -low;  ///< of the returns along the sides
  Eigen::Vector2d beams_low = low, beams_high = high;  ///< of all beams within the rectangle, whatever they met
};

Sampling samplingOf(const Patch& patch) {
  Sampling sampling;
  Eigen::Vector2d along_row = Eigen::Vector2d::UnitX();
  for (const Row& row : patch.rows) {
    int count = 0;
    Eigen::Vector2d first = Eigen::Vector2d::Zero(), last = first;
    for (const Beam& beam : row.beams) {
      if (patch.rectangle.signedDistance(beam.hit) > kRim_m) continue;
      sampling.beams_low = sampling.beams_low.cwiseMin(patch.rectangle.local(beam.hit));
      sampling.beams_high = sampling.beams_high.cwiseMax(patch.rectangle.local(beam.hit));
      if (beam.verdict != Verdict::kOn) continue;
      last = patch.rectangle.local(beam.hit);
      sampling.low = sampling.low.cwiseMin(last);
      sampling.high = sampling.high.cwiseMax(last);
      if (count++ == 0) first = last;
    }
    if (count < 3) continue;
    ++sampling.rows;
    if ((last - first).norm() > 0.1) along_row = (last - first).normalized();
  }
  const Eigen::Vector2d along = along_row.cwiseAbs(), across(along.y(), along.x());
  sampling.spacing_m = patch.step_m * along + patch.gap_m * across;
  return sampling;
}

/// Whether the returns reach all sides, and the plate is as large as it should be, as far as the beams' spacing tells.
/// @param may_be_cut  a part of the plate, and not too small a one, does where the sensor's field of view ends
bool hasPlateSize(const Patch& patch, int min_rows, bool may_be_cut) {
  const Sampling sampling = samplingOf(patch);
  const bool ringless = patch.rows.size() == 1 && patch.rows.front().ring < 0;
  if (!ringless && sampling.rows < min_rows) return false;
  const Eigen::Vector2d size = 2.0 * patch.rectangle.half_m;
  const Eigen::Vector2d reached = sampling.high - sampling.low;
  Eigen::Vector2d reachable = size;
  if (may_be_cut) {
    reachable = (sampling.beams_high - sampling.beams_low).cwiseMax(kMinPart * size).cwiseMin(size);
  }
  const Eigen::Vector2d measured = 2.0 * fitSize(patch).half_m;
  for (int axis = 0; axis < 2; ++axis) {
    if (reached[axis] < (1.0 - kSizeTolerance) * reachable[axis] - 2.0 * sampling.spacing_m[axis]) return false;
    if (std::abs(measured[axis] - size[axis]) > kSizeTolerance * size[axis] + sampling.spacing_m[axis]) return false;
  }
  return true;
}

}  // namespace

std::optional<Patch> fitPatch(const Sweep& sweep, const Plane& plane, const std::vector<int>& members,
                              const Eigen::Vector3d& start_centre_L, const Eigen::Vector3d& start_side_L,
                              const Eigen::Vector2d& size_m, bool any_roll) {
  const double radius = 0.5 * size_m.norm() + kSurround_m;
  std::vector<int> support = members;
  Plane fitted = plane;
  Eigen::Vector3d centre = start_centre_L, side = start_side_L;
  std::optional<Patch> patch;
  // The second pass sees the plane refitted to the plate alone, and the beams around its middle.
  for (int pass = 0; pass < 2; ++pass) {
    patch = Patch{PlaneFrame(fitted, centre, side), {}, {}, 0.0, 0.0, {}, 1.0};
    patch->rectangle.half_m = 0.5 * size_m;
    patch->rows = beamsNear(sweep, patch->frame, support, radius);
    Evidence evidence = evidenceOf(patch->rows);
    if (evidence.on.size() < kMinMembers) return std::nullopt;
    if (any_roll && !mayHoldPlate(evidence, patch->rectangle.centre, size_m)) return std::nullopt;
    patch->rectangle = placeRectangle(evidence, patch->rectangle, any_roll && pass == 0);
    const double step_rad = azimuthStep(patch->rows);
    addMissing(patch->rows, patch->rectangle, step_rad, &evidence);
    const Evidence decisive = nearOutline(evidence, patch->rectangle);
    fitRectangle(decisive.on, decisive.off, false, kFineScale_m, &patch->rectangle);

    const double range = patch->frame.point(patch->rectangle.centre).norm();
    patch->step_m = step_rad * range;
    patch->gap_m = ringGap(sweep, patch->rows);
    support = membersOf(patch->rows, patch->rectangle, kRim_m);
    const auto refitted = fitPlane(sweep, support);
    if (!refitted) return std::nullopt;
    fitted = *refitted;
    centre = patch->frame.point(patch->rectangle.centre);
    side = patch->frame.point(patch->rectangle.centre + Eigen::Vector2d(std::cos(patch->rectangle.angle_rad),
                                                                        std::sin(patch->rectangle.angle_rad))) -
           centre;
  }
  const auto misfit = judgeFit(*patch);
  if (!misfit || !hasPlateSize(*patch, any_roll ? kMinRowsUnpredicted : kMinRows, !any_roll)) return std::nullopt;
  patch->misfit = *misfit;
  patch->members = support;
  patch->frame.plane = fitted;
  return patch;
}

Rectangle measureRectangle(const Patch& patch) {
  Rectangle rectangle = fitSize(patch);
  if (rectangle.half_m.x() < rectangle.half_m.y()) {
    std::swap(rectangle.half_m.x(), rectangle.half_m.y());
    rectangle.angle_rad += M_PI_2;
  }
  return rectangle;
}

}  // namespace cocalib::plate
