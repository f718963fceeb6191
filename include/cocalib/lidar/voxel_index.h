#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <vector>

namespace cocalib {

/// Whole-number coordinates of a voxel: its lower corner over its edge length.
using Voxel = Eigen::Vector3i;

/// Voxel of edge length 1 / inverse_edge that holds `p`. @pre p is finite and within voxelInRange()
inline Voxel voxelOf(const Eigen::Vector3d& p, double inverse_edge) {
  // std::floor is a function call on plain x86-64, and this is called for every point.
  const auto floorOf = [inverse_edge](double x) {
    const int whole = static_cast<int>(x * inverse_edge);
    return whole - (x * inverse_edge < whole ? 1 : 0);
  };
  return {floorOf(p.x()), floorOf(p.y()), floorOf(p.z())};
}

/// Whether the voxel of `p` (and its neighbours) can be numbered; false for anything that is not finite.
inline bool voxelInRange(const Eigen::Vector3d& p, double inverse_edge) {
  constexpr double kLimit = (1 << 20) - 4;  // 21 bits for each coordinate
  return (p.array().abs() * inverse_edge < kLimit).all();
}

/// Numbers voxels: hash table with open addressing from a voxel to the number under which the owner keeps its data in a
/// vector. The owner walks that vector, never the table, so no result depends on the order of a hash.
class VoxelIndex {
 public:
  VoxelIndex() : slots_(kInitialSlots) {}

  /// Number of the voxel, or -1.
  int find(const Voxel& voxel) const {
    const std::uint64_t key = keyOf(voxel);
    for (std::size_t i = firstSlot(key);; i = (i + 1) & (slots_.size() - 1)) {
      if (slots_[i].key == key) return slots_[i].number;
      if (slots_[i].key == kEmpty) return -1;
    }
  }

  /// Number of the voxel; a new voxel gets size() as its number.
  int findOrInsert(const Voxel& voxel) {
    if (2 * size_ >= static_cast<int>(slots_.size())) grow();
    const std::uint64_t key = keyOf(voxel);
    for (std::size_t i = firstSlot(key);; i = (i + 1) & (slots_.size() - 1)) {
      if (slots_[i].key == key) return slots_[i].number;
      if (slots_[i].key != kEmpty) continue;
      slots_[i] = {key, size_};
      return size_++;
    }
  }

  int size() const { return size_; }

  void clear() {
    slots_.assign(kInitialSlots, Slot{});
    size_ = 0;
  }

 private:
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};  // keys have 63 bits
  static constexpr std::size_t kInitialSlots = 1024;          // a power of two, as all sizes of the table
  struct Slot {
    std::uint64_t key = kEmpty;
    int number = -1;
  };

  static std::uint64_t keyOf(const Voxel& voxel) {
    constexpr int kOffset = 1 << 20;
    constexpr std::uint64_t kMask = (1U << 21) - 1;
    const auto part = [](int x) { return static_cast<std::uint64_t>(x + kOffset) & kMask; };
    return part(voxel.x()) << 42 | part(voxel.y()) << 21 | part(voxel.z());
  }

  std::size_t firstSlot(std::uint64_t key) const {
    const std::uint64_t mixed =
        key * 0x9E3779B97F4A7C15ULL;  // Fibonacci hashing: the high bits depend on all of the key
    return static_cast<std::size_t>(mixed >> 32) & (slots_.size() - 1);
  }

  void grow() {
    std::vector<Slot> old(2 * slots_.size());
    old.swap(slots_);
    for (const Slot& slot : old) {
      if (slot.key == kEmpty) continue;
      std::size_t i = firstSlot(slot.key);
      while (slots_[i].key != kEmpty) i = (i + 1) & (slots_.size() - 1);
      slots_[i] = slot;
    }
  }

  std::vector<Slot> slots_;
  int size_ = 0;
};

}  // namespace cocalib
