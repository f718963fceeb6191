#include "cocalib/monitor/input_doctor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace cocalib {
namespace {

constexpr double kFirstLookS = 2.5, kLookPeriodS = 1.0;
constexpr double kSilenceS = 4.0;
constexpr std::size_t kLeastMessages = 10;
constexpr std::size_t kLeastForRate = 4;  // of a sensor that comes once a second ten would take ten seconds
constexpr double kLeastImuHz = 50.0, kGoodImuHz = 100.0, kMostImuHz = 2000.0;
constexpr double kLeastCameraHz = 5.0;
constexpr double kLeastLidarHz = 3.0, kMostLidarHz = 40.0;
constexpr double kMostJitter = 0.15;  // of a period; the distance to the nearest multiple of it is 0.5 at most
constexpr double kMostLost = 0.05, kMostRepeated = 0.02;
// The calibrators find clock offsets of a tenth of a second by themselves; transport delays most of the rest.
constexpr double kClockApartS = 0.5;
constexpr double kLateS = 3.0;          // a message may be late by that on a busy machine
constexpr double kClockDomainsS = 1e6;  // no unsynchronised clock is that far off; another epoch is
constexpr double kYearS = 365.25 * 86400.0;
constexpr std::size_t kLeastSpans = 5, kMostSpans = 50;
constexpr double kShortSweep = 0.1, kLongSweep = 3.0;  // of the time between two sweeps

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[320];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

}  // namespace

InputDoctor::InputDoctor(Topics topics) : topics_(std::move(topics)) {}

void InputDoctor::report(Finding finding) {
  if (said_.insert(finding.check).second) findings_.push_back(std::move(finding));
}

std::vector<Finding> InputDoctor::takeNew() {
  std::vector<Finding> fresh(findings_.begin() + static_cast<std::ptrdiff_t>(taken_), findings_.end());
  taken_ = findings_.size();
  return fresh;
}

bool InputDoctor::awaitsSensor() const {
  const auto awaited = [](const std::string& topic, const StreamClock& clock) {
    return !topic.empty() && clock.count() == 0;
  };
  return awaited(topics_.imu, imu_) || awaited(topics_.camera, camera_) || awaited(topics_.lidar, lidar_);
}

void InputDoctor::restart() {
  imu_ = StreamClock(2000);
  camera_ = StreamClock(300);
  lidar_ = StreamClock(100);
  plausibility_ = ImuPlausibility();
  first_.reset();
  last_examined_.reset();
  spans_s_.clear();
}

void InputDoctor::addImu(const ImuSample& sample, TimeNs received) {
  imu_.add(sample.stamp, received);
  plausibility_.add(sample);
  tick(received);
}

void InputDoctor::addImage(TimeNs stamp, TimeNs received) {
  camera_.add(stamp, received);
  tick(received);
}

void InputDoctor::addSweep(TimeNs stamp, TimeNs received, std::optional<double> span_s) {
  lidar_.add(stamp, received);
  if (span_s && spans_s_.size() < kMostSpans) spans_s_.push_back(*span_s);
  tick(received);
}

void InputDoctor::tick(TimeNs now) {
  if (!first_) first_ = now;
  if (toSeconds(now - *first_) < kFirstLookS) return;
  if (last_examined_ && std::abs(toSeconds(now - *last_examined_)) < kLookPeriodS) return;
  last_examined_ = now;
  examine();
  if (toSeconds(now - *first_) < kSilenceS) return;
  const auto silent = [this](const std::string& name, const std::string& topic, const StreamClock& clock) {
    if (topic.empty() || clock.count() > 0) return;
    report({name + " silent", topic + ": nothing has come on it so far",
            "start the driver, or correct " + name + ": topic in the rig file (rostopic list shows what there is)",
            Finding::Weight::kError});
  };
  silent("imu", topics_.imu, imu_);
  silent("camera", topics_.camera, camera_);
  silent("lidar", topics_.lidar, lidar_);
}

void InputDoctor::examine() {
  const StreamClock::Summary imu = imu_.summary();
  examineJump("imu", topics_.imu, imu_);
  examineJump("camera", topics_.camera, camera_);
  examineJump("lidar", topics_.lidar, lidar_);
  if (imu_.count() >= kLeastMessages) {
    examineImuRate(imu);
    examineRegularity("imu", topics_.imu, imu);
    for (Finding& finding : plausibility_.findings(topics_.imu)) report(std::move(finding));
  }
  if (camera_.count() >= kLeastForRate) examineCamera(imu);
  if (lidar_.count() >= kLeastForRate) examineLidar(imu);
}

void InputDoctor::examineImuRate(const StreamClock::Summary& imu) {
  const double rate = imu.rate_hz();
  if (rate <= 0.0 || (rate >= kGoodImuHz && rate <= kMostImuHz)) return;
  const bool unusable = rate < kLeastImuHz || rate > kMostImuHz;
  report({"imu rate",
          format("%s: %.0f samples per second, %.0f to %.0f are needed", topics_.imu.c_str(), rate,
                 unusable ? kLeastImuHz : kGoodImuHz, kMostImuHz),
          rate > kMostImuHz ? "lower the rate in the driver" : "raise the rate in the driver, to 200 or more if it can",
          unusable ? Finding::Weight::kError : Finding::Weight::kWarning});
}

void InputDoctor::examineRegularity(const std::string& name, const std::string& topic,
                                    const StreamClock::Summary& summary) {
  if (summary.repeated_share > kMostRepeated) {
    report({name + " stamps",
            format("%s: %.0f %% of the stamps repeat or run backwards", topic.c_str(), 100.0 * summary.repeated_share),
            "have the driver stamp every message by its own time; look for two drivers on one topic",
            Finding::Weight::kError});
  }
  if (summary.lost_share > kMostLost) {
    report({name + " losses",
            format("%s: %.0f %% of the messages are missing", topic.c_str(), 100.0 * summary.lost_share),
            "look at the load of the machine, the bandwidth and the queues between driver and recorder"});
  }
  if (summary.jitter_s > std::max(kMostJitter * summary.period_s, 2e-4)) {
    report({name + " jitter",
            format("%s: stamps scatter by %.1f ms about their period of %.1f ms, as times of arrival do", topic.c_str(),
                   1e3 * summary.jitter_s, 1e3 * summary.period_s),
            "have the driver stamp with the sensor's own clock or a hardware trigger; the clock offset cannot be known "
            "better than that"});
  }
}

void InputDoctor::examineJump(const std::string& name, const std::string& topic, const StreamClock& clock) {
  if (clock.jump_s() <= 0.0) return;  // back: everything has started over, and said so
  report({name + " jump", format("%s: its clock was set ahead by %.3g s", topic.c_str(), clock.jump_s()),
          "let the clocks settle before a calibration, and have them slewed, not stepped, while it runs (chrony)"});
}

void InputDoctor::examineClock(const std::string& name, const std::string& topic, double lag_s, double imu_lag_s) {
  const double apart = imu_lag_s - lag_s;  // stamp of the sensor minus that of the IMU, at one time
  if (std::abs(apart) < kClockApartS) return;
  const bool domains = std::abs(apart) > kClockDomainsS;
  const std::string distance =
      std::abs(apart) > kYearS ? format("%.1f years", std::abs(apart) / kYearS) : format("%.3g s", std::abs(apart));
  const bool late = apart < 0.0 && apart > -kLateS;
  report({name + " clock",
          topic + ": stamps are " + distance + (apart > 0.0 ? " ahead of" : " behind") + " those of " + topics_.imu +
              (domains ? ": one clock counts from its start, the other from 1970"
               : late  ? ": its messages come late, or the clocks are not synchronised"
                       : ": the clocks are not synchronised"),
          late ? "look at the load of the machine; synchronise the clocks (chrony, PTP)"
          : domains
              ? "have both drivers stamp with the host's time (a time-source or use_ros_time setting), or synchronise "
                "the sensor by PTP"
              : "synchronise the clocks (chrony, PTP), or have both drivers stamp with the host's time",
          late ? Finding::Weight::kWarning : Finding::Weight::kError});
}

void InputDoctor::examineCamera(const StreamClock::Summary& imu) {
  const StreamClock::Summary camera = camera_.summary();
  if (camera.rate_hz() > 0.0 && camera.rate_hz() < kLeastCameraHz) {
    report({"camera rate", format("%s: %.1f pictures per second", topics_.camera.c_str(), camera.rate_hz()),
            "10 or more let features be followed; raise the rate or shorten the exposure"});
  }
  if (camera_.count() >= kLeastMessages) examineRegularity("camera", topics_.camera, camera);
  if (imu_.count() >= kLeastMessages) examineClock("camera", topics_.camera, camera.lag_s, imu.lag_s);
}

void InputDoctor::examineLidar(const StreamClock::Summary& imu) {
  const StreamClock::Summary lidar = lidar_.summary();
  const double rate = lidar.rate_hz();
  if (rate > kMostLidarHz) {
    report({"lidar rate",
            format("%s: %.0f clouds per second: these are packets, not sweeps", topics_.lidar.c_str(), rate),
            "have the driver publish whole revolutions", Finding::Weight::kError});
  } else if (rate > 0.0 && rate < kLeastLidarHz) {
    report({"lidar rate", format("%s: %.1f sweeps per second", topics_.lidar.c_str(), rate),
            "10 is usual; raise the rate of revolution, and do not accumulate sweeps"});
  }
  if (lidar_.count() >= kLeastMessages) examineRegularity("lidar", topics_.lidar, lidar);
  if (imu_.count() >= kLeastMessages) examineClock("lidar", topics_.lidar, lidar.lag_s, imu.lag_s);
  if (rate > 0.0) examinePointTimes(lidar.period_s);
}

void InputDoctor::examinePointTimes(double period_s) {
  if (spans_s_.size() < kLeastSpans) return;
  std::vector<double> sorted = spans_s_;
  std::sort(sorted.begin(), sorted.end());
  const double span = sorted[sorted.size() / 2], ratio = span / period_s;
  if (span > 0.0 && ratio >= kShortSweep && ratio <= kLongSweep) return;
  const std::string seen =
      format("%s: the points of a sweep span %.3g s, sweeps come every %.3g s", topics_.lidar.c_str(), span, period_s);
  if (span <= 0.0) {
    report(
        {"point times", seen + ": all points carry the same time",
         "have the driver give every point its time, or set lidar: point_time: {field: none} and scan_period, so that "
         "it is computed from the azimuth",
         Finding::Weight::kError});
    return;
  }
  report({"point times",
          seen + format(": their unit is off by a factor of about 1e%.0f", std::round(std::log10(ratio) / 3.0) * 3.0),
          "set lidar: point_time: unit in the rig file to what the driver means (s, ms, us or ns)",
          Finding::Weight::kError});
}

void InputDoctor::compareSizes(int width, int height, int model_width, int model_height) {
  if (width == model_width && height == model_height) return;
  const double scale = static_cast<double>(width) / model_width;
  const bool scaled = std::abs(scale * model_height - height) < 1.0;
  report(
      {"camera size",
       format("%s: pictures are %d x %d, the camera model is for %d x %d", topics_.camera.c_str(), width, height,
              model_width, model_height),
       scaled
           ? format(
                 "the driver scales them by %.4g: calibrate the lens at this size, or scale the intrinsics by it too",
                 scale)
           : "give the intrinsics of this picture (resolution and camera_info of another one, or of a cut-out)",
       Finding::Weight::kError});
}

void InputDoctor::compareFrames(const std::string& section, const std::string& topic, const std::string& in_message,
                                const std::string& in_rig) {
  if (in_message.empty() || in_message == in_rig || in_message == "/" + in_rig) return;
  report({section + " frame", topic + ": its messages are in the frame " + in_message + ", the rig file says " + in_rig,
          "correct " + section + ": frame in the rig file, or tf will not fit the data", Finding::Weight::kWarning});
}

}  // namespace cocalib
