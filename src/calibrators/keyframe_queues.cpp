#include "cocalib/calibrators/keyframe_queues.h"

#include <algorithm>
#include <utility>

namespace cocalib {

bool KeyframeQueues::add(VisualKeyframe keyframe) {
  const StampOrder::Verdict order = visual_order.take(keyframe.stamp);
  if (order == StampOrder::Verdict::kDrop) return false;
  if (order == StampOrder::Verdict::kSetBack) visual.clear();
  visual.push_back(std::move(keyframe));
  return true;
}

bool KeyframeQueues::add(LidarKeyframe keyframe) {
  const StampOrder::Verdict order = lidar_order.take(keyframe.scan.stamp);
  if (order == StampOrder::Verdict::kDrop) return false;
  if (order == StampOrder::Verdict::kSetBack) lidar.clear();
  lidar.push_back(std::move(keyframe));
  return true;
}

std::size_t KeyframeQueues::forgetOlderThan(double seconds) {
  std::size_t forgotten = 0;
  for (; !visual.empty() && toSeconds(visual.back().stamp - visual.front().stamp) > seconds; ++forgotten) {
    visual.pop_front();
  }
  for (; !lidar.empty() && toSeconds(lidar.back().scan.stamp - lidar.front().scan.stamp) > seconds; ++forgotten) {
    lidar.pop_front();
  }
  return forgotten;
}

std::optional<TimeNs> KeyframeQueues::horizon(std::optional<double> camera_offset_s,
                                              std::optional<double> lidar_offset_s) const {
  if ((camera_offset_s && visual.empty()) || (lidar_offset_s && lidar.empty())) return std::nullopt;
  std::optional<TimeNs> until;
  if (camera_offset_s) until = visual.back().stamp + toNs(*camera_offset_s);
  if (lidar_offset_s) {
    const LidarScan& scan = lidar.back().scan;
    const double sweep_s = scan.points.empty() ? 0.0 : scan.points.back().offset_s;
    const TimeNs end = scan.stamp + toNs(*lidar_offset_s + sweep_s);
    until = until ? std::min(*until, end) : end;
  }
  return until;
}

void KeyframeQueues::drop() {
  visual.clear();
  lidar.clear();
}

void KeyframeQueues::clear() {
  drop();
  visual_order.reset();
  lidar_order.reset();
}

}  // namespace cocalib
