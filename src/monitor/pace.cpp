#include "cocalib/monitor/pace.h"

#include <algorithm>

namespace cocalib {
namespace {

constexpr double kPeriod_s = 1.0;
// Of the shortest wait within a period: a single long job, as the search for the mounting is one, delays much, but what
// comes after it has been worked off soon.
constexpr double kShort = 0.4;   // of what is too long
constexpr double kLast_s = 0.8;  // what waited longer is left out on a machine that is too slow
constexpr double kFall = 0.7, kRise = 1.1;
constexpr double kTooSlow = 0.6, kFastAgain = 0.95;

}  // namespace

bool Pace::take(double now_s, double waited_s) {
  shortest_s_ = std::min(shortest_s_, waited_s);
  if (!judged_s_) judged_s_ = now_s;
  if (now_s - *judged_s_ >= kPeriod_s) {
    if (shortest_s_ > long_s_) share_ = std::max(kLeast, kFall * share_);
    if (shortest_s_ < kShort * long_s_) share_ = std::min(1.0, kRise * share_);
    if (share_ < kTooSlow) too_slow_ = true;
    if (share_ > kFastAgain) too_slow_ = false;
    judged_s_ = now_s;
    shortest_s_ = waited_s;
  }
  return !too_slow_ || waited_s <= kLast_s;
}

Finding tooSlow(const std::string& part) {
  return {part + " too slow",
          "too slow: this machine cannot work off all data of the " + part + "; fewer are used, which costs accuracy",
          "end what else runs, play a recording at a lower rate, or record the data and use calibrate_bag"};
}

}  // namespace cocalib
