#pragma once

#include <cstdint>
#include <deque>
#include <mutex>
#include <vector>

#include "cocalib/inertial/imu_buffer.h"

namespace cocalib {

/// Takes inertial samples from any thread and hands them to the thread that estimates, so that neither waits for the
/// other longer than a copy takes.
class ImuInbox {
 public:
  void push(const ImuSample& sample) {
    const std::lock_guard<std::mutex> lock(mutex_);
    waiting_.push_back(sample);
    if (waiting_.size() <= kMaxWaiting) return;
    waiting_.pop_front();  // the oldest: who has not asked for so long starts with the newest
    ++dropped_;
  }

  /// Moves what has come into `buffer`. @return false if the clock was set back (the sample after the jump is kept for
  /// the next call): the owner starts over, then calls again
  bool drainTo(ImuBuffer* buffer) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      draining_.insert(draining_.end(), waiting_.begin(), waiting_.end());
      waiting_.clear();
    }
    for (std::size_t i = 0; i < draining_.size(); ++i) {
      const ImuBuffer::Push result = buffer->push(draining_[i]);
      if (result == ImuBuffer::Push::kTimeJump) {
        draining_.erase(draining_.begin(), draining_.begin() + static_cast<std::ptrdiff_t>(i));
        return false;
      }
      if (result != ImuBuffer::Push::kAccepted) ++refused_;
    }
    draining_.clear();
    return true;
  }

  std::uint64_t dropped() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return dropped_;
  }
  /// Samples that were not finite or not newer than the one before; call from the draining thread.
  std::uint64_t refused() const { return refused_; }

 private:
  static constexpr std::size_t kMaxWaiting = 200000;  // 100 s at 2 kHz

  mutable std::mutex mutex_;
  std::deque<ImuSample> waiting_;
  std::vector<ImuSample> draining_;
  std::uint64_t dropped_ = 0, refused_ = 0;
};

}  // namespace cocalib
