#include "cocalib/initialization/chunks.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cocalib {
namespace {

constexpr double kMaxImuGap_s = 0.05;  // 50 Hz, the slowest IMU that is accepted, misses one sample

/// Ends of stretches that the IMU covers without a gap, as index ranges of the stamps.
std::vector<std::pair<std::size_t, std::size_t>> coveredStretches(const ImuBuffer& imu,
                                                                  const std::vector<TimeNs>& stamps) {
  std::vector<std::pair<std::size_t, std::size_t>> stretches;
  bool open = false;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    if (!imu.at(stamps[i])) {
      open = false;
      continue;
    }
    if (open && imu.longestGap(stamps[i - 1], stamps[i]) <= kMaxImuGap_s) {
      stretches.back().second = i + 1;
    } else {
      stretches.emplace_back(i, i + 1);
      open = true;
    }
  }
  return stretches;
}

}  // namespace

std::vector<Chunk> splitIntoChunks(const ImuBuffer& imu, const std::vector<TimeNs>& imu_stamps, double chunk_s,
                                   const Eigen::Vector3d& gyro_bias, const Eigen::Vector3d& accel_bias) {
  std::vector<Chunk> chunks;
  for (const auto& [begin, end] : coveredStretches(imu, imu_stamps)) {
    if (end - begin < 2) continue;
    const double duration = toSeconds(imu_stamps[end - 1] - imu_stamps[begin]);
    const double count = std::max(1.0, std::round(duration / chunk_s));
    std::size_t first = begin;
    for (int k = 1; first < end; ++k) {
      const TimeNs limit = imu_stamps[begin] + toNs(duration * k / count);
      std::size_t last = first;
      while (last < end && (imu_stamps[last] < limit || k >= static_cast<int>(count))) ++last;
      if (last == first) continue;
      if (end - last < 2) last = end;  // a chunk of one measurement says nothing
      const bool continues = last < end;
      auto path = InertialPath::integrate(imu, imu_stamps[first], imu_stamps[continues ? last : last - 1], gyro_bias,
                                          accel_bias);
      if (path) chunks.push_back({first, last, std::move(*path), continues});
      first = last;
    }
  }
  return chunks;
}

}  // namespace cocalib
