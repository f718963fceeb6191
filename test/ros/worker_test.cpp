#include "cocalib/ros/worker.h"

#include <gtest/gtest.h>

#include <future>
#include <stdexcept>
#include <vector>

namespace cocalib {
namespace {

TEST(Worker, RunsJobsOfAllLanesInOrder) {
  Worker worker({10, 10});
  std::vector<int> ran;
  for (int i = 0; i < 8; ++i) worker.post(i % 2, [&ran, i] { ran.push_back(i); });
  worker.drain();
  EXPECT_EQ(ran, (std::vector<int>{0, 1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(worker.dropped(0) + worker.dropped(1), 0U);
}

TEST(Worker, FullLaneLosesItsOldestAndCountsIt) {
  Worker worker({3, 2});
  std::promise<void> started, release;
  worker.post(0, [&] {
    started.set_value();
    release.get_future().wait();
  });
  started.get_future().wait();  // from here the thread is busy and everything queues
  std::vector<int> ran;
  for (int i = 0; i < 5; ++i) worker.post(1, [&ran, i] { ran.push_back(i); });
  worker.post(0, [&ran] { ran.push_back(100); });
  EXPECT_EQ(worker.waiting(1), 2U);
  EXPECT_EQ(worker.dropped(1), 3U);
  EXPECT_EQ(worker.dropped(0), 0U);
  release.set_value();
  worker.drain();
  EXPECT_EQ(ran, (std::vector<int>{3, 4, 100}));
}

TEST(Worker, StopDropsWhatWaitsAndEndsDrains) {
  Worker worker({5});
  std::promise<void> started, release;
  bool second_ran = false;
  worker.post(0, [&] {
    started.set_value();
    release.get_future().wait();
  });
  started.get_future().wait();
  worker.post(0, [&] { second_ran = true; });
  std::thread stopper([&] { worker.stop(); });
  while (worker.waiting(0) != 0) std::this_thread::yield();
  release.set_value();
  stopper.join();
  EXPECT_FALSE(second_ran);
  worker.drain();
  worker.post(0, [&] { second_ran = true; });
  EXPECT_EQ(worker.waiting(0), 0U);
}

TEST(Worker, RefusesUselessLanes) {
  EXPECT_THROW(Worker(std::vector<std::size_t>{}), std::invalid_argument);
  EXPECT_THROW(Worker({1, 0}), std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
