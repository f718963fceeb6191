#include "cocalib/ros/stream_guard.h"

namespace cocalib {
namespace {

constexpr TimeNs kRestartNs = 1'000'000'000;
// Data may come this much before the first or after the newest IMU sample: clock offset, transport, a busy machine.
constexpr TimeNs kEarlyNs = 1'000'000'000;
constexpr TimeNs kLateNs = 5'000'000'000;

}  // namespace

StreamGuard::Verdict StreamGuard::onImu(TimeNs stamp) {
  if (first_ && stamp <= last_ && stamp > last_ - kRestartNs) return Verdict::kDrop;
  const bool restart = first_ && stamp <= last_;
  if (!first_ || restart) first_ = stamp;
  last_ = stamp;
  return restart ? Verdict::kRestart : Verdict::kGood;
}

bool StreamGuard::accepts(TimeNs stamp) const {
  return !first_ || (stamp >= *first_ - kEarlyNs && stamp <= last_ + kLateNs);
}

}  // namespace cocalib
