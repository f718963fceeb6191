#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cocalib/measurements/finding.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/monitor/imu_plausibility.h"
#include "cocalib/monitor/stream_clock.h"

namespace cocalib {

/// Looks at what comes in, from the first message on, and says what is wrong with it and what to do: rates, jitter and
/// losses, clocks that do not belong together, units, saturation, times of points, sizes of pictures, silence. Every
/// check speaks once. It changes nothing: what it finds is for the user. Not thread-safe. Deterministic.
///
/// `received` is a time on one clock for all streams: the host's, or that of the recording.
class InputDoctor {
 public:
  /// Topics as the user knows them; empty: there is no such sensor.
  struct Topics {
    std::string imu, camera, lidar;
  };
  explicit InputDoctor(Topics topics);

  void addImu(const ImuSample& sample, TimeNs received);
  void addImage(TimeNs stamp, TimeNs received);
  /// @param span_s  time between its first and its last point; nothing if the sweep was not read or has no times
  void addSweep(TimeNs stamp, TimeNs received, std::optional<double> span_s);
  /// What the picture is, and what its camera model is for [px].
  void compareSizes(int width, int height, int model_width, int model_height);
  /// What the messages' header says, and what the rig file says. @param section  of the rig file: "imu", "camera"
  void compareFrames(const std::string& section, const std::string& topic, const std::string& in_message,
                     const std::string& in_rig);
  /// A finding made elsewhere (the wrong board).
  void report(Finding finding);
  /// Time goes on, also where nothing comes. @param now  on the clock of `received`
  void tick(TimeNs now);

  /// Findings that have not been taken yet.
  std::vector<Finding> takeNew();
  const std::vector<Finding>& findings() const { return findings_; }
  /// Whether there is a sensor of which nothing has come yet.
  bool awaitsSensor() const;
  /// Begins anew, and keeps what was found.
  void restart();

 private:
  void examine();
  void examineRegularity(const std::string& name, const std::string& topic, const StreamClock::Summary& summary);
  void examineImuRate(const StreamClock::Summary& imu);
  void examineCamera(const StreamClock::Summary& imu);
  void examineLidar(const StreamClock::Summary& imu);
  void examineJump(const std::string& name, const std::string& topic, const StreamClock& clock);
  void examineClock(const std::string& name, const std::string& topic, double lag_s, double imu_lag_s);
  void examinePointTimes(double period_s);

  Topics topics_;
  StreamClock imu_{2000}, camera_{300}, lidar_{100};
  ImuPlausibility plausibility_;
  std::optional<TimeNs> first_, last_examined_;
  std::vector<double> spans_s_;
  std::vector<Finding> findings_;
  std::set<std::string> said_;  // checks
  std::size_t taken_ = 0;
};

}  // namespace cocalib
