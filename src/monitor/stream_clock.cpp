#include "cocalib/monitor/stream_clock.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cocalib {
namespace {

constexpr double kJump_s = 5.0;  // by which messages do not come early or late

/// Value below which `part` of the numbers lie.
double quantile(std::vector<double> values, double part) {
  if (values.empty()) return 0.0;
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

}  // namespace

void StreamClock::add(TimeNs stamp, TimeNs received) {
  ++count_;
  newest_.push_back({stamp, received});
  if (newest_.size() > keep_) newest_.pop_front();
  noteJump();
}

/// Two messages in a row: a single wrong stamp sets no clock.
void StreamClock::noteJump() {
  const std::size_t n = newest_.size();
  if (n < 3) return;
  const double before_s = newest_[n - 3].lag_s(), first_s = newest_[n - 2].lag_s(), second_s = newest_[n - 1].lag_s();
  if (std::abs(first_s - before_s) < kJump_s || std::abs(second_s - before_s) < kJump_s) return;
  if (std::abs(second_s - first_s) > kJump_s) return;
  jump_s_ = before_s - second_s;
  newest_.erase(newest_.begin(), newest_.end() - 2);
}

StreamClock::Summary StreamClock::summary() const {
  Summary summary;
  std::vector<double> intervals, lags;
  std::size_t repeated = 0;
  for (std::size_t i = 0; i < newest_.size(); ++i) {
    lags.push_back(newest_[i].lag_s());
    if (i == 0) continue;
    if (std::abs(lags.back() - newest_[i - 1].lag_s()) > kJump_s) continue;  // to a wrong stamp or back
    const double interval = toSeconds(newest_[i].stamp - newest_[i - 1].stamp);
    if (interval > 0.0)
      intervals.push_back(interval);
    else
      ++repeated;
  }
  summary.lag_s = quantile(std::move(lags), 0.5);
  if (newest_.size() > 1) {
    summary.repeated_share = static_cast<double>(repeated) / static_cast<double>(newest_.size() - 1);
  }
  const double middle = quantile(intervals, 0.5);
  if (middle <= 0.0) return summary;
  // The mean of what is about the median: where stamps are whole milliseconds, 2 and 3 take turns.
  double sum = 0.0;
  int whole = 0;
  for (const double interval : intervals) {
    if (interval > 1.75 * middle) continue;
    sum += interval;
    ++whole;
  }
  summary.period_s = sum / whole;
  std::vector<double> deviations;
  double lost = 0.0;
  for (const double interval : intervals) {
    const double periods = std::max(1.0, std::round(interval / summary.period_s));
    lost += periods - 1.0;
    deviations.push_back(std::abs(interval - periods * summary.period_s));
  }
  summary.jitter_s = quantile(std::move(deviations), 0.9);
  summary.lost_share = lost / (lost + static_cast<double>(intervals.size()));
  return summary;
}

}  // namespace cocalib
