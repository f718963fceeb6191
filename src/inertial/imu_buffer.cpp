#include "cocalib/inertial/imu_buffer.h"

#include <algorithm>
#include <limits>

#include "cocalib/measurements/validity.h"

namespace cocalib {
namespace {

/// A step back of more than this is a clock that was set back, not a late message.
constexpr TimeNs kTimeJumpNs = 1'000'000'000;

bool isBefore(const ImuSample& sample, TimeNs stamp) { return sample.stamp < stamp; }

/// Linear between two samples; exact (bit by bit) at both ends.
ImuSample interpolate(const ImuSample& a, const ImuSample& b, TimeNs stamp) {
  if (stamp == a.stamp) return a;
  if (stamp == b.stamp) return b;
  const double s = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  return {stamp, a.gyro + s * (b.gyro - a.gyro), a.accel + s * (b.accel - a.accel)};
}

}  // namespace

ImuBuffer::Push ImuBuffer::push(const ImuSample& sample) {
  if (!isUsable(sample)) return Push::kNotFinite;
  if (!samples_.empty()) {
    const TimeNs last = samples_.back().stamp;
    if (last - sample.stamp > kTimeJumpNs) return Push::kTimeJump;
    if (sample.stamp <= last) return Push::kNotNewer;
  }
  samples_.push_back(sample);
  while (toSeconds(sample.stamp - samples_.front().stamp) > keep_s_) samples_.pop_front();
  return Push::kAccepted;
}

std::optional<ImuSample> ImuBuffer::at(TimeNs stamp) const {
  if (empty() || stamp < firstStamp() || stamp > lastStamp()) return std::nullopt;
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp, isBefore);
  if (after->stamp == stamp) return *after;
  return interpolate(*(after - 1), *after, stamp);
}

std::pair<ImuBuffer::Iterator, ImuBuffer::Iterator> ImuBuffer::between(TimeNs from, TimeNs to) const {
  const auto first = std::lower_bound(samples_.begin(), samples_.end(), from + 1, isBefore);
  return {first, std::lower_bound(first, samples_.end(), to, isBefore)};
}

std::vector<ImuSample> ImuBuffer::slice(TimeNs from, TimeNs to) const {
  if (to <= from || empty() || from < firstStamp() || to > lastStamp()) return {};
  const auto [first, last] = between(from, to);
  std::vector<ImuSample> result;
  result.reserve(static_cast<std::size_t>(last - first) + 2);
  result.push_back(interpolate(*(first - 1), *first, from));
  result.insert(result.end(), first, last);
  result.push_back(interpolate(*(last - 1), *last, to));
  return result;
}

ImuSample ImuBuffer::withoutCurvature(Iterator sample) const {
  constexpr double kMaxUnevenness = 1.2;  // of the spacing to both sides; else there is no second difference
  ImuSample result = *sample;
  if (sample == samples_.begin() || sample + 1 == samples_.end()) return result;
  const ImuSample &before = *(sample - 1), &after = *(sample + 1);
  const double left = toSeconds(sample->stamp - before.stamp), right = toSeconds(after.stamp - sample->stamp);
  if (left > kMaxUnevenness * right || right > kMaxUnevenness * left) return result;
  result.gyro -= (before.gyro - 2.0 * sample->gyro + after.gyro) / 12.0;
  return result;
}

std::vector<ImuSample> ImuBuffer::sliceForIntegration(TimeNs from, TimeNs to) const {
  if (to <= from || empty() || from < firstStamp() || to > lastStamp()) return {};
  const auto [first, last] = between(from, to);
  std::vector<ImuSample> result;
  result.reserve(static_cast<std::size_t>(last - first) + 2);
  result.push_back(interpolate(withoutCurvature(first - 1), withoutCurvature(first), from));
  for (auto sample = first; sample != last; ++sample) result.push_back(withoutCurvature(sample));
  result.push_back(interpolate(withoutCurvature(last - 1), withoutCurvature(last), to));
  return result;
}

double ImuBuffer::longestGap(TimeNs from, TimeNs to) const {
  if (to < from || empty() || from < firstStamp() || to > lastStamp()) return std::numeric_limits<double>::infinity();
  auto next = std::lower_bound(samples_.begin(), samples_.end(), from + 1, isBefore);
  TimeNs longest = 0;
  for (; next != samples_.end(); ++next) {
    const TimeNs previous = (next - 1)->stamp;
    if (previous >= to) break;
    longest = std::max(longest, next->stamp - previous);
  }
  return toSeconds(longest);
}

TimeNs ImuBuffer::unbrokenSince(double longest_s, TimeNs until) const {
  for (auto sample = samples_.rbegin(); sample + 1 != samples_.rend(); ++sample) {
    if (sample->stamp > until) continue;
    if (toSeconds(sample->stamp - (sample + 1)->stamp) > longest_s) return sample->stamp;
  }
  return firstStamp();
}

void ImuBuffer::forgetBefore(TimeNs stamp) {
  while (samples_.size() > 1 && samples_[1].stamp <= stamp) samples_.pop_front();
}

}  // namespace cocalib
