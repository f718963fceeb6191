#include "cocalib/monitor/pace.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace cocalib {
namespace {

/// One thread that works off a stream of 20 messages a second, each of which costs what share of it is used.
class Machine {
 public:
  explicit Machine(Pace* pace) : pace_(*pace) {}

  /// @param load  work that all data of a second would take [s]
  void run(double seconds, double load) {
    worst_wait_s_ = 0.0;
    for (const double end_s = came_s_ + seconds; came_s_ < end_s; came_s_ += kPeriod_s) {
      free_s_ = std::max(free_s_, came_s_);
      const double waited_s = free_s_ - came_s_;
      worst_wait_s_ = std::max(worst_wait_s_, waited_s);
      if (pace_.take(free_s_, waited_s)) free_s_ += load * kPeriod_s * pace_.share();
    }
  }
  /// A job that has nothing to do with the amount of data.
  void stall(double seconds) { free_s_ = std::max(free_s_, came_s_) + seconds; }
  double worstWait_s() const { return worst_wait_s_; }

 private:
  static constexpr double kPeriod_s = 0.05;
  Pace& pace_;
  double came_s_ = 0.0, free_s_ = 0.0, worst_wait_s_ = 0.0;
};

TEST(Pace, UsesEverythingWhereTheMachineKeepsUp) {
  Pace pace;
  Machine machine(&pace);
  machine.run(60.0, 0.9);
  EXPECT_EQ(pace.share(), 1.0);
  EXPECT_FALSE(pace.tooSlow());
}

TEST(Pace, KeepsTheDelayUnderASecondWhereItIsTooSlow) {
  for (const double load : {1.2, 2.0, 3.5}) {
    SCOPED_TRACE(load);
    Pace pace;
    Machine machine(&pace);
    machine.run(5.0, load);
    EXPECT_LT(machine.worstWait_s(), 2.5);  // until it has noticed
    machine.run(300.0, load);
    EXPECT_LT(machine.worstWait_s(), 1.0);
    EXPECT_LT(pace.share(), 1.3 / load);
    EXPECT_GT(pace.share(), 0.4 / load);
    EXPECT_TRUE(pace.tooSlow() || load < 1.5);
  }
}

TEST(Pace, LeavesOutWhatIsTooLateEvenForTheLeast) {
  Pace pace;
  Machine machine(&pace);
  machine.run(60.0, 20.0);
  EXPECT_EQ(pace.share(), Pace::kLeast);
  EXPECT_TRUE(pace.tooSlow());
  machine.run(60.0, 20.0);
  EXPECT_LT(machine.worstWait_s(), 1.0);
}

TEST(Pace, UsesEverythingAgainWhenTheMachineIsFreeAgain) {
  Pace pace;
  Machine machine(&pace);
  machine.run(60.0, 4.0);
  ASSERT_TRUE(pace.tooSlow());
  machine.run(40.0, 0.5);
  EXPECT_EQ(pace.share(), 1.0);
  EXPECT_FALSE(pace.tooSlow());
}

TEST(Pace, SingleLongJobsAreNotASlowMachine) {
  Pace pace;
  Machine machine(&pace);
  for (int i = 0; i < 3; ++i) {
    machine.run(20.0, 0.5);
    EXPECT_EQ(pace.share(), 1.0);
    machine.stall(2.0);
    machine.run(3.0, 0.5);
    EXPECT_FALSE(pace.tooSlow());
    EXPECT_GE(pace.share(), 0.49);
  }
}

}  // namespace
}  // namespace cocalib
