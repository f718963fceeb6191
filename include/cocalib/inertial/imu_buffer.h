#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Inertial samples in order of time. Not thread-safe: its owner locks.
class ImuBuffer {
 public:
  enum class Push { kAccepted, kNotFinite, kNotNewer, kTimeJump };

  /// @param keep_s   samples older than this before the newest are forgotten [s]
  explicit ImuBuffer(double keep_s = 1e9) : keep_s_(keep_s) {}

  /// Appends one sample. A sample that is not finite (or not usable), or not newer than the last, is refused; one that
  /// is more than a second before the last is kTimeJump: the clock was set back (a bag looped), the caller must start
  /// over.
  Push push(const ImuSample& sample);

  bool empty() const { return samples_.empty(); }
  std::size_t size() const { return samples_.size(); }
  TimeNs firstStamp() const { return samples_.front().stamp; }
  TimeNs lastStamp() const { return samples_.back().stamp; }

  /// Sample linearly interpolated at `stamp`; nothing outside the buffer.
  std::optional<ImuSample> at(TimeNs stamp) const;

  /// Samples that cover [from, to]: first one exactly at `from`, last one exactly at `to` (interpolated), the raw
  /// ones between. Empty if the buffer does not cover the interval, or `to` <= `from`.
  std::vector<ImuSample> slice(TimeNs from, TimeNs to) const;

  /// As slice(), with every rate lessened by a twelfth of its second difference: the trapezoidal rule over these is
  /// exact to the third order of the spacing h (Euler-Maclaurin), while over raw rates it loses (w h)^2 / 12 of a turn
  /// that swings with w rad/s. That is 3e-5 at 1.2 Hz and 400 Hz: a tenth of a millimetre of a camera's position.
  std::vector<ImuSample> sliceForIntegration(TimeNs from, TimeNs to) const;

  /// Longest time between two neighbouring samples that reach into [from, to] [s]; infinite if the buffer does not
  /// cover the interval.
  double longestGap(TimeNs from, TimeNs to) const;

  /// Stamp of the newest sample up to `until` that came more than `longest_s` after the one before; of the first where
  /// none did. The buffer must not be empty.
  TimeNs unbrokenSince(double longest_s, TimeNs until) const;

  /// Forgets what is not needed for times from `stamp` on: the sample at or just before it stays.
  void forgetBefore(TimeNs stamp);
  void clear() { samples_.clear(); }
  const std::deque<ImuSample>& samples() const { return samples_; }

 private:
  using Iterator = std::deque<ImuSample>::const_iterator;
  /// Samples strictly between the ends: [first, second).
  std::pair<Iterator, Iterator> between(TimeNs from, TimeNs to) const;
  ImuSample withoutCurvature(Iterator sample) const;

  double keep_s_;
  std::deque<ImuSample> samples_;
};

}  // namespace cocalib
