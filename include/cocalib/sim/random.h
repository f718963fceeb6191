#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

namespace cocalib::sim {

/// Random numbers that are the same on every platform and independent of the order in which measurements are made:
/// each stream is named by (seed, stream, index), e.g. (run, range noise, number of the scan).
/// xoshiro256** (Blackman and Vigna, 2018) seeded by splitmix64; normals by Box-Muller.
class Random {
 public:
  /// What the numbers are for; streams of the same seed are independent.
  enum class Stream : std::uint64_t { kMotion = 1, kBias, kImu, kRange, kTracks, kCorners, kTexture, kPixels, kFaults };

  Random(std::uint64_t seed, Stream stream, std::uint64_t index = 0) {
    std::uint64_t x = mix(mix(seed) ^ mix(static_cast<std::uint64_t>(stream) << 32U) ^ mix(~index));
    for (std::uint64_t& word : state_) word = mix(x += 0x9E3779B97F4A7C15ULL);
  }

  std::uint64_t bits() {
    const std::uint64_t result = rotate(state_[1] * 5, 7) * 9;
    const std::uint64_t t = state_[1] << 17U;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = rotate(state_[3], 45);
    return result;
  }

  /// Uniform in [low, high).
  double uniform(double low = 0.0, double high = 1.0) {
    return low + (high - low) * static_cast<double>(bits() >> 11U) * 0x1.0p-53;
  }

  /// Zero mean, unit variance.
  double normal() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    const double angle = uniform(0.0, 6.283185307179586);
    spare_ = radius * std::sin(angle);
    has_spare_ = true;
    return radius * std::cos(angle);
  }

  Eigen::Vector3d normal3() {
    const double x = normal(), y = normal();
    return {x, y, normal()};
  }

 private:
  static std::uint64_t rotate(std::uint64_t x, unsigned k) { return (x << k) | (x >> (64U - k)); }
  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31U);
  }

  std::uint64_t state_[4];
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace cocalib::sim
