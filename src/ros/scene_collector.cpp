#include "cocalib/ros/scene_collector.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/image_reader.h"
#include "cocalib/ros/imu_reader.h"
#include "cocalib/ros/overlay.h"
#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {
namespace {

constexpr std::size_t kMostSpread = 12, kMostNewest = 6;
constexpr TimeNs kSpreadPeriodNs = 1'000'000'000, kNewestPeriodNs = 450'000'000;
constexpr TimeNs kImuAroundNs = 400'000'000;  // covers a sweep that begins a sweep before the picture, and offsets
constexpr TimeNs kPairNs = 150'000'000;       // picture and sweep belong together up to here
constexpr TimeNs kStateNs = 100'000'000;      // a state this near gives velocity and biases

}  // namespace

SceneCollector::SceneCollector(const RigConfig& rig, Keep keep) : rig_(rig), keep_(keep) { clear(); }

void SceneCollector::clear() {
  recent_imu_.clear();
  recent_clouds_.clear();
  candidates_.clear();
  period_ns_ = keep_ == Keep::kSpread ? kSpreadPeriodNs : kNewestPeriodNs;
}

void SceneCollector::addImu(const sensor_msgs::Imu& msg) {
  const std::optional<ImuSample> sample = readImu(msg, nullptr);
  if (!sample) return;
  if (!recent_imu_.empty() && sample->stamp <= recent_imu_.back().stamp) {
    if (sample->stamp < recent_imu_.back().stamp - 1'000'000'000)
      clear();  // the clock was set back
    else
      return;
  }
  recent_imu_.push_back(*sample);
  while (recent_imu_.back().stamp - recent_imu_.front().stamp > kImuAroundNs) recent_imu_.pop_front();
  if (candidates_.empty()) return;
  Candidate& last = candidates_.back();
  if (sample->stamp < last.stamp + kImuAroundNs) last.imu.push_back(*sample);
}

void SceneCollector::addCloud(const sensor_msgs::PointCloud2ConstPtr& msg) {
  recent_clouds_.push_back(msg);
  while (recent_clouds_.size() > 2) recent_clouds_.pop_front();
}

void SceneCollector::addImage(const sensor_msgs::ImageConstPtr& msg) {
  Candidate candidate;
  candidate.stamp = toTimeNs(msg->header.stamp);
  candidate.image = msg;
  startCandidate(std::move(candidate));
}

void SceneCollector::addImage(const sensor_msgs::CompressedImageConstPtr& msg) {
  Candidate candidate;
  candidate.stamp = toTimeNs(msg->header.stamp);
  candidate.compressed = msg;
  startCandidate(std::move(candidate));
}

void SceneCollector::startCandidate(Candidate candidate) {
  if (recent_clouds_.empty()) return;
  if (!candidates_.empty() && candidate.stamp - candidates_.back().stamp < period_ns_) return;
  const TimeNs sweep = toTimeNs(recent_clouds_.back()->header.stamp);
  if (std::abs(candidate.stamp - sweep) > kPairNs) return;
  candidate.cloud = recent_clouds_.back();
  candidate.imu.assign(recent_imu_.begin(), recent_imu_.end());
  makeRoom();
  candidates_.push_back(std::move(candidate));
}

void SceneCollector::makeRoom() {
  if (keep_ == Keep::kNewest) {
    if (candidates_.size() == kMostNewest) candidates_.erase(candidates_.begin());
    return;
  }
  if (candidates_.size() < kMostSpread) return;
  for (std::size_t i = 0; i < kMostSpread / 2; ++i) candidates_[i] = std::move(candidates_[2 * i]);
  candidates_.resize(kMostSpread / 2);
  period_ns_ *= 2;
}

void SceneCollector::addState(const NavState& state) {
  for (Candidate& candidate : candidates_) {
    const TimeNs distance = std::abs(state.stamp - candidate.stamp);
    if (distance > kStateNs) continue;
    if (!candidate.state || distance < std::abs(candidate.state->stamp - candidate.stamp)) candidate.state = state;
  }
}

std::optional<OverlayScene> SceneCollector::decode(const Candidate& candidate) const {
  const std::optional<ImageFrame> image =
      candidate.image ? readImage(*candidate.image, nullptr) : readImage(*candidate.compressed, nullptr);
  // A reader of its own: what it recognises at the first cloud it recognises at this one.
  PointCloudReader reader(*rig_.lidar);
  std::optional<LidarScan> scan = reader.read(*candidate.cloud, nullptr);
  if (!image || !scan) return std::nullopt;
  return OverlayScene{*image, std::move(*scan), candidate.imu, candidate.state};
}

std::optional<OverlayScene> SceneCollector::best(const Calibration& calibration, const CameraModel& camera,
                                                 const std::optional<Pose>& T_W_B) const {
  std::optional<OverlayScene> best;
  int best_score = -1;
  for (const Candidate& candidate : candidates_) {
    std::optional<OverlayScene> scene = decode(candidate);
    if (!scene || scene->image.gray.cols != camera.width() || scene->image.gray.rows != camera.height()) continue;
    // Points on the board show best whether the sensors agree.
    const OverlayCounts counts = countOverlay(*scene, {calibration, T_W_B, ""}, camera, rig_.target);
    const int score = counts.visible + (counts.whole_board ? 2000 : 1000) * counts.on_board;
    if (score <= best_score) continue;
    best_score = score;
    best = std::move(scene);
  }
  return best;
}

std::vector<OverlayScene> SceneCollector::some(std::size_t count) const {
  std::vector<const Candidate*> usable;
  for (const Candidate& candidate : candidates_) {
    if (candidate.state) usable.push_back(&candidate);
  }
  std::vector<OverlayScene> scenes;
  const std::size_t picked = std::min(count, usable.size());
  for (std::size_t i = 0; i < picked; ++i) {
    // The middles of `picked` equal parts.
    std::optional<OverlayScene> scene = decode(*usable[(2 * i + 1) * usable.size() / (2 * picked)]);
    if (scene) scenes.push_back(std::move(*scene));
  }
  return scenes;
}

std::optional<OverlayScene> SceneCollector::newest() const {
  if (candidates_.empty()) return std::nullopt;
  // States come a second or two late; without one the board and the velocity are missing from the picture.
  const auto with_state = std::find_if(candidates_.rbegin(), candidates_.rend(),
                                       [](const Candidate& candidate) { return candidate.state.has_value(); });
  if (with_state != candidates_.rend()) return decode(*with_state);
  // The last but one has all of its inertial data.
  return decode(candidates_.size() > 1 ? candidates_[candidates_.size() - 2] : candidates_.back());
}

std::optional<OverlayScene> SceneCollector::newest(const std::function<bool(TimeNs stamp)>& wanted) const {
  const auto found = std::find_if(candidates_.rbegin(), candidates_.rend(), [&](const Candidate& candidate) {
    return candidate.state && wanted(candidate.stamp);
  });
  if (found == candidates_.rend()) return std::nullopt;
  return decode(*found);
}

}  // namespace cocalib
