#include "cocalib/ros/worker.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace cocalib {

Worker::Worker(std::vector<std::size_t> lane_capacities) {
  if (lane_capacities.empty()) throw std::invalid_argument("worker: needs at least one lane");
  for (const std::size_t capacity : lane_capacities) {
    if (capacity == 0) throw std::invalid_argument("worker: a lane must hold at least one job");
    lanes_.push_back({capacity, 0, 0});
  }
  thread_ = std::thread([this] { runJobs(); });
}

Worker::~Worker() { stop(); }

void Worker::post(std::size_t lane, std::function<void()> job) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_) return;
    Lane& target = lanes_.at(lane);
    if (target.waiting == target.capacity) {
      const auto oldest = std::find_if(jobs_.begin(), jobs_.end(), [lane](const Job& j) { return j.lane == lane; });
      jobs_.erase(oldest);
      --target.waiting;
      ++target.dropped;
    }
    jobs_.push_back({++last_ticket_, lane, std::move(job), std::chrono::steady_clock::now()});
    ++target.waiting;
  }
  changed_.notify_all();
}

void Worker::drain() {
  std::unique_lock<std::mutex> lock(mutex_);
  const std::uint64_t goal = last_ticket_;
  changed_.wait(lock, [this, goal] {
    const bool queued = !jobs_.empty() && jobs_.front().ticket <= goal;
    const bool running = running_ticket_ != 0 && running_ticket_ <= goal;
    return stopping_ || (!queued && !running);
  });
}

void Worker::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    jobs_.clear();
    for (Lane& lane : lanes_) lane.waiting = 0;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::size_t Worker::waiting(std::size_t lane) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return lanes_.at(lane).waiting;
}

std::uint64_t Worker::dropped(std::size_t lane) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return lanes_.at(lane).dropped;
}

double Worker::takeWorstLatency() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::chrono::duration<double>(std::exchange(worst_latency_, {})).count();
}

void Worker::runJobs() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stopping_ || !jobs_.empty(); });
    if (stopping_) return;
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    --lanes_[job.lane].waiting;
    running_ticket_ = job.ticket;
    lock.unlock();
    job.run();
    job.run = nullptr;  // what it holds (pictures, sweeps) goes now, outside the lock
    lock.lock();
    running_ticket_ = 0;
    worst_latency_ = std::max(worst_latency_, std::chrono::steady_clock::now() - job.posted);
    changed_.notify_all();
  }
}

}  // namespace cocalib
