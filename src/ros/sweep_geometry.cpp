#include "cocalib/ros/sweep_geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cocalib {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kSectors = 36;
constexpr int kSpinningSectors = 12;  // with fewer seen, nothing turns
constexpr double kFiringStep = 0.1;   // [rad] neighbours in the cloud further apart say nothing of the direction
// Lasers of one firing lie less than this apart; a gap in the sweep may have 2 pi less it.
constexpr double kBackwardLimit = 0.5 * kPi;
constexpr double kStartMargin = 0.1;         // [rad] by which a ring may start ahead of the cloud's first point
constexpr std::size_t kRingNumbers = 32769;  // -1 ... 32767

constexpr int kElevationBins = 3600;  // 0.05 deg each
constexpr int kMinRings = 4;
constexpr int kMaxRings = 256;
constexpr double kMaxRingWidth = 0.3;   // [deg]
constexpr double kMinRingShare = 0.95;  // of the points must lie on rings
constexpr int kSineBins = 1 << 14;      // 0.007 deg at the horizon

double wrap(double angle) {
  if (angle > kPi) return angle - 2.0 * kPi;
  return angle < -kPi ? angle + 2.0 * kPi : angle;
}

std::vector<double> azimuthsOf(const std::vector<LidarPoint>& points) {
  std::vector<double> azimuths(points.size());
  std::transform(points.begin(), points.end(), azimuths.begin(),
                 [](const LidarPoint& point) { return static_cast<double>(std::atan2(point.p.y(), point.p.x())); });
  return azimuths;
}

/// In which order the points of a sweep stand, and which way it turns.
struct Order {
  enum Kind { kFiring, kRingByRing, kNone } kind = kNone;
  bool directed = false;
  double direction = -1.0;  // most lidars turn clockwise
};

Order findOrder(const std::vector<LidarPoint>& points, const std::vector<double>& azimuths) {
  double small_steps = 0.0;  // which way neighbours follow each other
  double turned = 0.0;
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    const double step = wrap(azimuths[i] - azimuths[i - 1]);
    turned += step;
    if (std::abs(step) < kFiringStep) small_steps += step;
  }
  Order order;
  order.directed = std::abs(small_steps) > 0.5 * kPi;
  if (!order.directed) return order;
  if (small_steps > 0.0) order.direction = 1.0;
  const bool has_rings = std::any_of(points.begin(), points.end(), [](const LidarPoint& p) { return p.ring >= 0; });
  if (std::abs(turned) < 3.0 * kPi) {
    order.kind = Order::kFiring;
  } else if (has_rings) {
    order.kind = Order::kRingByRing;
  }
  return order;
}

/// Angle turned since the sweep's start, followed from point to point, so that it may pass 2 pi.
class PhaseThread {
 public:
  explicit PhaseThread(double start_azimuth) : azimuth_(start_azimuth) {}

  double advance(double azimuth, double direction) {
    double step = direction * wrap(azimuth - azimuth_);
    if (step < (started_ ? -kBackwardLimit : -kStartMargin)) step += 2.0 * kPi;
    azimuth_ = azimuth;
    started_ = true;
    return phase_ += step;
  }

 private:
  double azimuth_;
  double phase_ = 0.0;
  bool started_ = false;
};

int countSectors(const std::vector<double>& azimuths) {
  std::array<bool, kSectors> seen{};
  for (const double azimuth : azimuths) {
    const int sector = static_cast<int>((azimuth + kPi) / (2.0 * kPi) * kSectors);
    seen[static_cast<std::size_t>(std::clamp(sector, 0, kSectors - 1))] = true;
  }
  return static_cast<int>(std::count(seen.begin(), seen.end(), true));
}

/// Centre [deg] of every narrow heap of elevations, in rising order; empty if the points do not lie on rings.
std::vector<double> ringElevations(const std::vector<LidarPoint>& points) {
  std::vector<int> histogram(kElevationBins, 0);
  for (const LidarPoint& point : points) {
    const double elevation = std::atan2(point.p.z(), point.p.head<2>().norm()) * 180.0 / kPi;
    const int bin = static_cast<int>((elevation + 90.0) / 180.0 * kElevationBins);
    ++histogram[static_cast<std::size_t>(std::clamp(bin, 0, kElevationBins - 1))];
  }
  const int floor = std::max<int>(3, static_cast<int>(points.size() / 2000));
  std::vector<double> centres;
  std::size_t on_rings = 0;
  for (int begin = 0; begin < kElevationBins;) {
    if (histogram[begin] < floor) {
      ++begin;
      continue;
    }
    int end = begin;
    double weight = 0.0, sum = 0.0;
    for (; end < kElevationBins && histogram[end] >= floor; ++end) {
      weight += histogram[end];
      sum += histogram[end] * (end + 0.5);
    }
    const double width = (end - begin) * 180.0 / kElevationBins;
    if (width > kMaxRingWidth) return {};
    centres.push_back(sum / weight * 180.0 / kElevationBins - 90.0);
    on_rings += static_cast<std::size_t>(weight);
    begin = end;
  }
  const bool rings = static_cast<int>(centres.size()) >= kMinRings && static_cast<int>(centres.size()) <= kMaxRings &&
                     static_cast<double>(on_rings) >= kMinRingShare * static_cast<double>(points.size());
  return rings ? centres : std::vector<double>();
}

}  // namespace

SweepKind timesFromAzimuth(double period_s, LidarScan* scan) {
  std::vector<LidarPoint>& points = scan->points;
  const std::vector<double> azimuths = azimuthsOf(points);
  if (countSectors(azimuths) < kSpinningSectors) {
    for (LidarPoint& point : points) point.offset_s = 0.0F;
    return SweepKind::kNotSpinning;
  }
  const Order order = findOrder(points, azimuths);

  // In firing order one thread runs through the whole cloud; ring by ring, one through each ring; else there is none.
  std::vector<PhaseThread> threads(order.kind == Order::kRingByRing ? kRingNumbers : 1, PhaseThread(azimuths[0]));
  std::vector<double> times(points.size());
  double earliest = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::size_t thread = order.kind == Order::kRingByRing ? static_cast<std::size_t>(points[i].ring + 1) : 0;
    if (order.kind == Order::kNone) threads[0] = PhaseThread(azimuths[0]);
    times[i] = threads[thread].advance(azimuths[i], order.direction) * period_s / (2.0 * kPi);
    earliest = std::min(earliest, times[i]);
  }
  for (std::size_t i = 0; i < points.size(); ++i) points[i].offset_s = static_cast<float>(times[i] - earliest);
  scan->stamp += toNs(earliest);
  if (!order.directed) return SweepKind::kUnordered;
  return order.direction > 0.0 ? SweepKind::kCounterclockwise : SweepKind::kClockwise;
}

std::optional<RingTable> RingTable::build(const std::vector<LidarPoint>& points) {
  const std::vector<double> centres = ringElevations(points);
  if (centres.empty()) return std::nullopt;

  double spacing = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < centres.size(); ++i) spacing = std::min(spacing, centres[i] - centres[i - 1]);
  RingTable table;
  table.count_ = static_cast<int>(centres.size());
  table.by_sine_.assign(kSineBins, -1);
  for (int bin = 0; bin < kSineBins; ++bin) {
    const double elevation = std::asin((bin + 0.5) * 2.0 / kSineBins - 1.0) * 180.0 / kPi;
    const auto next = std::lower_bound(centres.begin(), centres.end(), elevation);
    auto nearest = next == centres.end() ? std::prev(next) : next;
    if (next != centres.begin() && elevation - *std::prev(next) < std::abs(*nearest - elevation)) {
      nearest = std::prev(next);
    }
    if (std::abs(*nearest - elevation) <= 0.5F * spacing) {
      table.by_sine_[static_cast<std::size_t>(bin)] = static_cast<std::int16_t>(nearest - centres.begin());
    }
  }
  return table;
}

std::int16_t RingTable::ring(const Eigen::Vector3f& p) const {
  const float sine = p.z() / p.norm();
  const int bin = static_cast<int>((sine + 1.0F) * 0.5F * kSineBins);
  return by_sine_[static_cast<std::size_t>(std::clamp(bin, 0, kSineBins - 1))];
}

}  // namespace cocalib
