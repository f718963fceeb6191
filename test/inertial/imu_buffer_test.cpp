#include "cocalib/inertial/imu_buffer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cocalib {
namespace {

constexpr TimeNs kStart = 1'700'000'000'000'000'000;  // today, where a double has lost the nanoseconds

ImuSample sampleAt(double seconds) {
  return {kStart + toNs(seconds), {seconds, 2.0 * seconds, -seconds}, {1.0, seconds, 9.81}};
}

ImuBuffer bufferOf(int count, double period_s, double keep_s = 1e9) {
  ImuBuffer buffer(keep_s);
  for (int i = 0; i < count; ++i) EXPECT_EQ(buffer.push(sampleAt(i * period_s)), ImuBuffer::Push::kAccepted);
  return buffer;
}

TEST(ImuBuffer, RefusesWhatIsNotFiniteNotNewerOrSetBack) {
  ImuBuffer buffer = bufferOf(300, 0.01);
  ImuSample bad = sampleAt(3.0);
  bad.gyro.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(buffer.push(bad), ImuBuffer::Push::kNotFinite);
  bad = sampleAt(3.0);
  bad.accel.z() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(buffer.push(bad), ImuBuffer::Push::kNotFinite);
  EXPECT_EQ(buffer.push(sampleAt(2.99)), ImuBuffer::Push::kNotNewer);
  EXPECT_EQ(buffer.push(sampleAt(2.5)), ImuBuffer::Push::kNotNewer);
  EXPECT_EQ(buffer.push(sampleAt(1.5)), ImuBuffer::Push::kTimeJump);
  EXPECT_EQ(buffer.size(), 300U);
}

TEST(ImuBuffer, InterpolatesLinearlyInsideAndNothingOutside) {
  const ImuBuffer buffer = bufferOf(11, 0.1);
  const auto middle = buffer.at(kStart + toNs(0.525));
  ASSERT_TRUE(middle);
  EXPECT_NEAR(middle->gyro.x(), 0.525, 1e-12);
  EXPECT_NEAR(middle->accel.y(), 0.525, 1e-12);
  EXPECT_EQ(middle->stamp, kStart + toNs(0.525));
  EXPECT_EQ(buffer.at(buffer.lastStamp())->gyro, sampleAt(1.0).gyro);
  EXPECT_EQ(buffer.at(buffer.firstStamp())->gyro, sampleAt(0.0).gyro);
  EXPECT_FALSE(buffer.at(buffer.lastStamp() + 1));
  EXPECT_FALSE(buffer.at(buffer.firstStamp() - 1));
  EXPECT_FALSE(ImuBuffer().at(kStart));
}

TEST(ImuBuffer, SliceStartsAndEndsExactlyWhereAsked) {
  const ImuBuffer buffer = bufferOf(11, 0.1);
  const auto slice = buffer.slice(kStart + toNs(0.25), kStart + toNs(0.55));
  ASSERT_EQ(slice.size(), 5U);  // 0.25, 0.3, 0.4, 0.5, 0.55
  EXPECT_EQ(slice.front().stamp, kStart + toNs(0.25));
  EXPECT_NEAR(slice.front().gyro.x(), 0.25, 1e-12);
  EXPECT_EQ(slice[1].stamp, kStart + toNs(0.3));
  EXPECT_EQ(slice.back().stamp, kStart + toNs(0.55));
  EXPECT_NEAR(slice.back().gyro.x(), 0.55, 1e-12);
}

TEST(ImuBuffer, SliceOnSamplesHoldsEachOnce) {
  const ImuBuffer buffer = bufferOf(11, 0.1);
  const auto slice = buffer.slice(kStart + toNs(0.2), kStart + toNs(0.5));
  ASSERT_EQ(slice.size(), 4U);
  for (std::size_t i = 0; i < slice.size(); ++i) EXPECT_EQ(slice[i].stamp, kStart + toNs(0.2) + toNs(0.1 * double(i)));
  EXPECT_EQ(buffer.slice(buffer.firstStamp(), buffer.lastStamp()).size(), buffer.size());
}

TEST(ImuBuffer, SliceWithinOneSamplePeriodHasTwoEnds) {
  const auto slice = bufferOf(11, 0.1).slice(kStart + toNs(0.42), kStart + toNs(0.44));
  ASSERT_EQ(slice.size(), 2U);
  EXPECT_NEAR(slice[0].gyro.x(), 0.42, 1e-12);
  EXPECT_NEAR(slice[1].gyro.x(), 0.44, 1e-12);
}

TEST(ImuBuffer, SliceIsEmptyWhereTheBufferDoesNotReach) {
  const ImuBuffer buffer = bufferOf(11, 0.1);
  EXPECT_TRUE(buffer.slice(kStart - 1, kStart + 10).empty());
  EXPECT_TRUE(buffer.slice(kStart, kStart + toNs(1.0) + 1).empty());
  EXPECT_TRUE(buffer.slice(kStart + 10, kStart + 10).empty());
  EXPECT_TRUE(buffer.slice(kStart + 20, kStart + 10).empty());
  EXPECT_TRUE(ImuBuffer().slice(kStart, kStart + 10).empty());
}

TEST(ImuBuffer, LongestGapSeesAGapThatReachesIntoTheInterval) {
  ImuBuffer buffer;
  for (const double t : {0.0, 0.1, 0.2, 0.6, 0.7, 0.8}) buffer.push(sampleAt(t));
  EXPECT_NEAR(buffer.longestGap(kStart, kStart + toNs(0.2)), 0.1, 1e-9);
  EXPECT_NEAR(buffer.longestGap(kStart, kStart + toNs(0.8)), 0.4, 1e-9);
  EXPECT_NEAR(buffer.longestGap(kStart + toNs(0.5), kStart + toNs(0.8)), 0.4, 1e-9);
  EXPECT_NEAR(buffer.longestGap(kStart + toNs(0.6), kStart + toNs(0.8)), 0.1, 1e-9);
  EXPECT_TRUE(std::isinf(buffer.longestGap(kStart, kStart + toNs(0.9))));
}

TEST(ImuBuffer, ForgetsTheOldButKeepsWhatInterpolationNeeds) {
  EXPECT_NEAR(toSeconds(bufferOf(1000, 0.01, 2.0).firstStamp() - kStart), 7.99, 1e-9);
  ImuBuffer buffer = bufferOf(11, 0.1);
  buffer.forgetBefore(kStart + toNs(0.45));
  EXPECT_EQ(buffer.firstStamp(), kStart + toNs(0.4));
  EXPECT_TRUE(buffer.at(kStart + toNs(0.45)));
  buffer.forgetBefore(kStart + toNs(5.0));
  EXPECT_EQ(buffer.size(), 1U);
}

}  // namespace
}  // namespace cocalib
