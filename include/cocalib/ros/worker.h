#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace cocalib {

/// One thread that runs jobs in the order in which they were posted. Every job belongs to a lane; a lane holds a
/// limited number of waiting jobs, and where it is full its oldest one is dropped and counted: a stream that cannot be
/// followed loses its past, not the memory of the machine. All functions may be called from any thread.
class Worker {
 public:
  /// @param lane_capacities  waiting jobs per lane, each >= 1
  /// @throws std::invalid_argument without lanes or with an empty one
  explicit Worker(std::vector<std::size_t> lane_capacities);
  /// Drops what waits, ends the running job, joins.
  ~Worker();
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// Jobs must not throw. @param lane  index into the capacities
  void post(std::size_t lane, std::function<void()> job);

  /// Waits until every job posted before has run; returns at once after stop(). Not from within a job.
  void drain();

  /// As the destructor, earlier. Not from within a job.
  void stop();

  std::size_t waiting(std::size_t lane) const;
  std::uint64_t dropped(std::size_t lane) const;
  /// Longest time from post() to the end of a job since the last call [s].
  double takeWorstLatency();

 private:
  struct Job {
    std::uint64_t ticket;
    std::size_t lane;
    std::function<void()> run;
    std::chrono::steady_clock::time_point posted;
  };
  struct Lane {
    std::size_t capacity = 0;
    std::size_t waiting = 0;
    std::uint64_t dropped = 0;
  };
  void runJobs();

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Lane> lanes_;
  std::deque<Job> jobs_;
  std::uint64_t last_ticket_ = 0;     // of the newest job; tickets grow along the queue
  std::uint64_t running_ticket_ = 0;  // 0: idle
  std::chrono::steady_clock::duration worst_latency_{0};
  bool stopping_ = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace cocalib
