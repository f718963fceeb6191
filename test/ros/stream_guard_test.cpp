#include "cocalib/ros/stream_guard.h"

#include <gtest/gtest.h>

#include "cocalib/ros/notices.h"

namespace cocalib {
namespace {

using Verdict = StreamGuard::Verdict;
constexpr TimeNs kStart = 1'700'000'000'000'000'000;

TEST(StreamGuard, RepeatedAndLateSamplesAreDroppedALoopRestarts) {
  StreamGuard guard;
  for (int s = 0; s <= 30; ++s) EXPECT_EQ(guard.onImu(kStart + toNs(s)), Verdict::kGood);
  EXPECT_EQ(guard.onImu(kStart + toNs(30.0)), Verdict::kDrop);
  EXPECT_EQ(guard.onImu(kStart + toNs(29.5)), Verdict::kDrop);
  EXPECT_EQ(guard.onImu(kStart), Verdict::kDrop);  // one alone may be a broken message
  EXPECT_EQ(guard.onImu(kStart + 1), Verdict::kRestart);
  EXPECT_EQ(guard.onImu(kStart + 2), Verdict::kGood);
}

TEST(StreamGuard, OneStampThatIsFarOffCostsOneSample) {
  for (const double off_s : {3600.0, -3600.0, 5.0, -1.5}) {
    StreamGuard guard;
    for (int i = 0; i < 10; ++i) guard.onImu(kStart + toNs(0.1 * i));
    EXPECT_EQ(guard.onImu(kStart + toNs(1.0 + off_s)), Verdict::kDrop) << off_s;
    EXPECT_EQ(guard.onImu(kStart + toNs(1.1)), Verdict::kGood) << off_s;
    EXPECT_TRUE(guard.accepts(kStart + toNs(0.5))) << off_s;
    EXPECT_FALSE(guard.accepts(kStart + toNs(3600.0))) << off_s;
  }
}

TEST(StreamGuard, DataThatComeBackAfterAPauseAreTheSameRun) {
  StreamGuard guard;
  guard.onImu(kStart);
  EXPECT_EQ(guard.onImu(kStart + toNs(60.0)), Verdict::kDrop);
  EXPECT_EQ(guard.onImu(kStart + toNs(60.1)), Verdict::kGood);
}

TEST(StreamGuard, LeftOversOfTheRunBeforeAreRecognised) {
  StreamGuard guard;
  EXPECT_TRUE(guard.accepts(kStart));  // nothing known yet
  for (int s = 0; s <= 60; ++s) guard.onImu(kStart + toNs(s));
  EXPECT_TRUE(guard.accepts(kStart + toNs(59.0)));
  guard.onImu(kStart);
  guard.onImu(kStart + 1);
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
