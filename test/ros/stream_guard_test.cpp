#include "cocalib/ros/stream_guard.h"

#include <gtest/gtest.h>

#include "cocalib/ros/notices.h"

namespace cocalib {
namespace {

using Verdict = StreamGuard::Verdict;
constexpr TimeNs kStart = 1'700'000'000'000'000'000;

TEST(StreamGuard, RepeatedAndLateSamplesAreDroppedALoopRestarts) {
  StreamGuard guard;
  EXPECT_EQ(guard.onImu(kStart), Verdict::kGood);
  EXPECT_EQ(guard.onImu(kStart + toNs(30.0)), Verdict::kGood);
  EXPECT_EQ(guard.onImu(kStart + toNs(30.0)), Verdict::kDrop);
  EXPECT_EQ(guard.onImu(kStart + toNs(29.5)), Verdict::kDrop);
  EXPECT_EQ(guard.onImu(kStart), Verdict::kRestart);
  EXPECT_EQ(guard.onImu(kStart + 1), Verdict::kGood);
}

TEST(StreamGuard, LeftOversOfTheRunBeforeAreRecognised) {
  StreamGuard guard;
  EXPECT_TRUE(guard.accepts(kStart));  // nothing known yet
  guard.onImu(kStart);
  guard.onImu(kStart + toNs(60.0));
  EXPECT_TRUE(guard.accepts(kStart + toNs(59.0)));
  guard.onImu(kStart);
  EXPECT_FALSE(guard.accepts(kStart + toNs(59.0)));
  EXPECT_TRUE(guard.accepts(kStart - toNs(0.1)));
  guard.reset();
  guard.onImu(kStart + toNs(100.0));
  EXPECT_FALSE(guard.accepts(kStart + toNs(59.0)));
}

TEST(Notices, SaysEveryLineOnceAndNotWithoutEnd) {
  Notices notices;
  notices.warn("a");
  notices.inform("a");
  const std::vector<Notice> first = notices.take();
  ASSERT_EQ(first.size(), 1U);
  EXPECT_EQ(first[0].text, "a");
  EXPECT_TRUE(first[0].warning);
  notices.warn("a");
  EXPECT_TRUE(notices.take().empty());
  for (int i = 0; i < 1000; ++i) notices.warn(std::to_string(i));
  EXPECT_LT(notices.take().size(), 50U);
  notices.count("x");
  notices.count("x");
  EXPECT_EQ(notices.counted("x"), 2U);
  EXPECT_EQ(notices.counted("y"), 0U);
}

}  // namespace
}  // namespace cocalib
