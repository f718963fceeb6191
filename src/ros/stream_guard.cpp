#include "cocalib/ros/stream_guard.h"

namespace cocalib {
namespace {

// Data may come this much before the first or after the newest IMU sample: clock offset, transport, a busy machine.
constexpr TimeNs kEarlyNs = 1'000'000'000;
constexpr TimeNs kLateNs = 5'000'000'000;

}  // namespace

StreamGuard::Verdict StreamGuard::onImu(TimeNs stamp) {
  const StampOrder::Verdict verdict = order_.take(stamp);
  if (verdict == StampOrder::Verdict::kDrop) return Verdict::kDrop;
  const bool restart = verdict == StampOrder::Verdict::kSetBack;
  if (!first_ || restart) first_ = stamp;
  return restart ? Verdict::kRestart : Verdict::kGood;
}

bool StreamGuard::accepts(TimeNs stamp) const {
  return !first_ || (stamp >= *first_ - kEarlyNs && stamp <= *order_.last() + kLateNs);
}

}  // namespace cocalib
