#include "cocalib/inertial/imu_inbox.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace cocalib {
namespace {

ImuSample sampleAt(TimeNs stamp) {
  ImuSample sample;
  sample.stamp = stamp;
  sample.accel = {0.0, 0.0, 9.81};
  return sample;
}

TEST(ImuInbox, HandsOverEverySampleOnceWhileMoreCome) {
  constexpr int kSamples = 20'000;
  ImuInbox inbox;
  ImuBuffer buffer;
  std::atomic<bool> done{false};
  std::thread driver([&] {
    for (int i = 1; i <= kSamples; ++i) inbox.push(sampleAt(i * TimeNs{2'500'000}));
    done = true;
  });
  while (!done) EXPECT_TRUE(inbox.drainTo(&buffer));
  driver.join();
  EXPECT_TRUE(inbox.drainTo(&buffer));
  EXPECT_EQ(buffer.samples().size(), static_cast<std::size_t>(kSamples));
  EXPECT_EQ(buffer.lastStamp(), kSamples * TimeNs{2'500'000});
  EXPECT_EQ(inbox.dropped() + inbox.refused(), 0U);
}

TEST(ImuInbox, TellsOfAClockThatWasSetBackAndKeepsWhatFollows) {
  ImuInbox inbox;
  ImuBuffer buffer;
  inbox.push(sampleAt(100'000'000'000));
  inbox.push(sampleAt(100'002'500'000));
  for (int i = 0; i < 3; ++i) inbox.push(sampleAt(10'000'000'000 + i * TimeNs{2'500'000}));
  EXPECT_FALSE(inbox.drainTo(&buffer));
  buffer.clear();
  EXPECT_TRUE(inbox.drainTo(&buffer));
  EXPECT_EQ(buffer.samples().size(), 3U);
  EXPECT_EQ(buffer.firstStamp(), 10'000'000'000);
}

TEST(ImuInbox, LosesTheOldestWhereNobodyAsks) {
  constexpr int kTooMany = 200'010;
  ImuInbox inbox;
  for (int i = 1; i <= kTooMany; ++i) inbox.push(sampleAt(i * TimeNs{500'000}));
  EXPECT_EQ(inbox.dropped(), 10U);
  ImuBuffer buffer;
  EXPECT_TRUE(inbox.drainTo(&buffer));
  EXPECT_EQ(buffer.firstStamp(), 11 * TimeNs{500'000});
  EXPECT_EQ(buffer.lastStamp(), kTooMany * TimeNs{500'000});
}

}  // namespace
}  // namespace cocalib
