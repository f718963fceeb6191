#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <utility>
#include <vector>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/point_cloud_writer.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::test {

/// A picture: what is seen in it, as if it had been drawn and searched, or, where its bytes are at stake, the message.
struct Picture {
  VisualKeyframe seen;
  std::optional<sensor_msgs::Image> raw;
  std::optional<sensor_msgs::CompressedImage> compressed;
};

/// A simulated drive with the rig of the paper's Table I as messages, with the time each was received. A test strikes
/// it with a fault and plays it.
struct Recording {
  enum class Kind { kImu, kCloud, kPicture, kInfo };
  struct Event {
    double received_s;  ///< since the begin
    Kind kind;
    sensor_msgs::Imu imu;
    sensor_msgs::PointCloud2 cloud;
    Picture picture;
    sensor_msgs::CameraInfo info;
  };
  std::vector<Event> events;
  sim::Scenario scenario;
  bool has_lidar = false;

  static Recording ofLidar() {
    sim::Scenario s = drive();
    s.camera.present = s.board.present = false;
    Recording r(s);
    r.addClouds();
    r.sort();
    return r;
  }
  /// @param board  whether the camera sees one
  static Recording ofCamera(bool board = true) {
    sim::Scenario s = drive();
    s.board.present = board;
    s.camera.rate_hz = 20.0;  // as many as the calibrator takes
    Recording r(s);
    r.addPictures();
    r.sort();
    return r;
  }

  static Recording ofRig() {
    sim::Scenario s = drive();
    s.camera.rate_hz = 20.0;
    Recording r(s);
    r.addClouds();
    r.addPictures();
    r.sort();
    return r;
  }

  /// Changes the messages of one kind received in [from, to) seconds; `change` gets the event and the number of the
  /// message, and says whether it is kept.
  template <typename Change>
  void change(Kind kind, double from, double to, const Change& change) {
    std::vector<Event> kept;
    int number = 0;
    for (Event& e : events) {
      const bool struck = e.kind == kind && e.received_s >= from && e.received_s < to;
      if (!struck || change(&e, number++)) kept.push_back(std::move(e));
    }
    events = std::move(kept);
  }
  /// Every nth message of one kind comes twice.
  void repeat(Kind kind, int nth) {
    std::vector<Event> more;
    int number = 0;
    for (Event& e : events) {
      more.push_back(e);
      if (e.kind == kind && ++number % nth == 0) more.push_back(e);
    }
    events = std::move(more);
  }
  /// Every nth message of one kind is received after its successors. @param late_s  by so much
  void delay(Kind kind, int nth, double late_s) {
    change(kind, 0.0, scenario.duration_s, [&](Event* e, int number) {
      if (number % nth == 0) e->received_s += late_s;
      return true;
    });
    sort();
  }

 private:
  static constexpr double kSweep_s = 0.1, kTransport_s = 0.005;

  explicit Recording(const sim::Scenario& s) : scenario(s), scene_(s), trajectory_(s) {
    for (const ImuSample& sample : sim::simulateImu(s, trajectory_)) {
      Event e = event(Kind::kImu, toSeconds(sample.stamp - s.epoch));
      e.imu.header.stamp = toRosTime(sample.stamp);
      e.imu.header.frame_id = s.imu_frame;
      e.imu.angular_velocity = toVectorMsg(sample.gyro);
      e.imu.linear_acceleration = toVectorMsg(sample.accel);
      events.push_back(std::move(e));
    }
  }
  /// A minute where the whole table is asked for: so that what a fault leaves is most of the data.
  static sim::Scenario drive() {
    sim::Scenario s;
    s.duration_s = std::getenv("COCALIB_FAULTS") != nullptr ? 60.0 : 24.0;
    return s;
  }
  static Event event(Kind kind, double received_s) { return {received_s, kind, {}, {}, {}, {}}; }

  void addClouds() {
    has_lidar = true;
    for (int k = 0; k < sim::scanCount(scenario); ++k) {
      const LidarScan scan = sim::simulateScan(scenario, scene_, trajectory_, k).scan;
      Event e = event(Kind::kCloud, toSeconds(scan.stamp - scenario.epoch) + kSweep_s + kTransport_s);
      e.cloud = toPointCloud2(scan, CloudLayout::kVelodyne, scenario.lidar.frame);
      events.push_back(std::move(e));
    }
  }
  void addPictures() {
    const sim::Scenario::Camera& c = scenario.camera;
    Event info = event(Kind::kInfo, -0.05);
    info.info.width = static_cast<std::uint32_t>(c.width);
    info.info.height = static_cast<std::uint32_t>(c.height);
    info.info.distortion_model = "plumb_bob";
    info.info.D = c.distortion;
    info.info.K = {c.intrinsics[0], 0.0, c.intrinsics[2], 0.0, c.intrinsics[1], c.intrinsics[3], 0.0, 0.0, 1.0};
    events.push_back(std::move(info));
    sim::TrackSimulator tracks(scenario, scene_, trajectory_);
    for (int k = 0; k < sim::imageCount(scenario); ++k) {
      const TimeNs stamp = sim::imageStamp(scenario, k);
      Event e = event(Kind::kPicture, toSeconds(stamp - scenario.epoch) + kTransport_s);
      e.picture.seen.stamp = stamp;
      e.picture.seen.tracks = tracks.observe(k);
      e.picture.seen.board = sim::simulateBoard(scenario, scene_, trajectory_, k);
      events.push_back(std::move(e));
    }
  }
  void sort() {
    std::stable_sort(events.begin(), events.end(),
                     [](const Event& a, const Event& b) { return a.received_s < b.received_s; });
  }

  sim::Scene scene_;
  sim::Trajectory trajectory_;
};

}  // namespace cocalib::test
