#include "cocalib/ros/sweep_geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cocalib {
namespace {

constexpr float kPi = 3.14159265358979F;
constexpr int kSectors = 36;
constexpr int kSpinningSectors = 12;  // with fewer seen, nothing turns
constexpr float kFiringStep = 0.1F;   // neighbours in the cloud further apart than this say nothing of the direction
constexpr float kBackwardLimit =
    0.5F * kPi;                           // lasers of one firing differ by less, gaps in a sweep are up to 2 pi less it
constexpr float kRingStartMargin = 0.1F;  // rings start at slightly different azimuths

constexpr int kElevationBins = 3600;  // 0.05 deg each
constexpr int kMinRings = 4;
constexpr int kMaxRings = 256;
constexpr float kMaxRingWidth = 0.3F;   // [deg]
constexpr double kMinRingShare = 0.95;  // of the points must lie on rings
constexpr int kSineBins = 1 << 14;      // 0.007 deg at the horizon

float wrap(float angle) {
  if (angle > kPi) return angle - 2.0F * kPi;
  return angle < -kPi ? angle + 2.0F * kPi : angle;
}

std::vector<float> azimuthsOf(const std::vector<LidarPoint>& points) {
  std::vector<float> azimuths(points.size());
  std::transform(points.begin(), points.end(), azimuths.begin(),
                 [](const LidarPoint& point) { return std::atan2(point.p.y(), point.p.x()); });
  return azimuths;
}

int countSectors(const std::vector<float>& azimuths) {
  std::array<bool, kSectors> seen{};
  for (const float azimuth : azimuths) {
    const int sector = static_cast<int>((azimuth + kPi) / (2.0F * kPi) * kSectors);
    seen[static_cast<std::size_t>(std::clamp(sector, 0, kSectors - 1))] = true;
  }
  return static_cast<int>(std::count(seen.begin(), seen.end(), true));
}

/// Centre [deg] of every narrow heap of elevations, in rising order; empty if the points do not lie on rings.
std::vector<float> ringElevations(const std::vector<LidarPoint>& points) {
  std::vector<int> histogram(kElevationBins, 0);
  for (const LidarPoint& point : points) {
    const float elevation = std::atan2(point.p.z(), point.p.head<2>().norm()) * 180.0F / kPi;
    const int bin = static_cast<int>((elevation + 90.0F) / 180.0F * kElevationBins);
    ++histogram[static_cast<std::size_t>(std::clamp(bin, 0, kElevationBins - 1))];
  }
  const int floor = std::max<int>(3, static_cast<int>(points.size() / 2000));
  std::vector<float> centres;
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
    const float width = static_cast<float>(end - begin) * 180.0F / kElevationBins;
    if (width > kMaxRingWidth) return {};
    centres.push_back(static_cast<float>(sum / weight * 180.0 / kElevationBins - 90.0));
    on_rings += static_cast<std::size_t>(weight);
    begin = end;
  }
  const bool rings = static_cast<int>(centres.size()) >= kMinRings && static_cast<int>(centres.size()) <= kMaxRings &&
                     static_cast<double>(on_rings) >= kMinRingShare * static_cast<double>(points.size());
  return rings ? centres : std::vector<float>();
}

}  // namespace

SweepKind timesFromAzimuth(double period_s, LidarScan* scan) {
  std::vector<LidarPoint>& points = scan->points;
  const std::vector<float> azimuths = azimuthsOf(points);
  if (countSectors(azimuths) < kSpinningSectors) {
    for (LidarPoint& point : points) point.offset_s = 0.0F;
    return SweepKind::kNotSpinning;
  }

  float small_steps = 0.0F;  // which way neighbours follow each other
  float turned = 0.0F;
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    const float step = wrap(azimuths[i] - azimuths[i - 1]);
    turned += step;
    if (std::abs(step) < kFiringStep) small_steps += step;
  }
  const bool ordered = std::abs(small_steps) > 0.5F * kPi;
  const float direction = ordered && small_steps > 0.0F ? 1.0F : -1.0F;
  const bool firing_order = ordered && std::abs(turned) < 3.0F * kPi;

  const float s_per_rad = static_cast<float>(period_s) / (2.0F * kPi);
  float phase = 0.0F;
  float earliest = 0.0F;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (firing_order && i > 0) {
      float step = direction * wrap(azimuths[i] - azimuths[i - 1]);
      if (step < -kBackwardLimit) step += 2.0F * kPi;
      phase += step;
    } else {
      phase = direction * wrap(azimuths[i] - azimuths[0]);
      if (phase < -kRingStartMargin) phase += 2.0F * kPi;
    }
    points[i].offset_s = phase * s_per_rad;
    earliest = std::min(earliest, points[i].offset_s);
  }
  for (LidarPoint& point : points) point.offset_s -= earliest;
  scan->stamp += toNs(static_cast<double>(earliest));
  if (!ordered) return SweepKind::kUnordered;
  return direction > 0.0F ? SweepKind::kCounterclockwise : SweepKind::kClockwise;
}

std::optional<RingTable> RingTable::build(const std::vector<LidarPoint>& points) {
  const std::vector<float> centres = ringElevations(points);
  if (centres.empty()) return std::nullopt;

  float spacing = std::numeric_limits<float>::infinity();
  for (std::size_t i = 1; i < centres.size(); ++i) spacing = std::min(spacing, centres[i] - centres[i - 1]);
  RingTable table;
  table.count_ = static_cast<int>(centres.size());
  table.by_sine_.assign(kSineBins, -1);
  for (int bin = 0; bin < kSineBins; ++bin) {
    const float elevation = std::asin((static_cast<float>(bin) + 0.5F) * 2.0F / kSineBins - 1.0F) * 180.0F / kPi;
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
