#include "cocalib/monitor/input_doctor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "cocalib/sim/imu.h"
#include "cocalib/sim/trajectory.h"

// One wrong input after the other: each must be found within five seconds, with its remedy, and nothing else be
// claimed.
namespace cocalib {
namespace {

constexpr TimeNs kStart = 1'700'000'000'000'000'000;

/// Five seconds of all three sensors as they should be, with hooks to spoil them.
struct Recording {
  double imu_hz = 400.0, camera_hz = 20.0, lidar_hz = 10.0, span_s = 0.1;
  double camera_ahead_s = 0.0, lidar_ahead_s = 0.0;
  double imu_jitter_s = 0.0, camera_jitter_s = 0.0, lidar_jitter_s = 0.0;
  double accel_scale = 1.0, gyro_scale = 1.0;
  double gyro_limit = 1e9;
  bool mirrored_gyro = false, no_gravity = false, repeat_stamps = false, with_camera = true;
  bool with_imu = true, with_lidar = true;
  int lose_every = 0;
  sim::Motion motion = sim::Motion::kFull;

  std::vector<Finding> examine() const {
    InputDoctor doctor({"/imu", "/camera", "/lidar"});
    sim::Scenario s;
    s.imu.rate_hz = imu_hz < 50.0 ? 50.0 : imu_hz;
    s.motion = motion;
    s.duration_s = 6.0;
    const std::vector<ImuSample> samples = sim::simulateImu(s, sim::Trajectory(s));
    std::mt19937 random(1);
    std::uniform_real_distribution<double> scatter(-1.0, 1.0);
    const TimeNs origin = samples.front().stamp;
    constexpr TimeNs kStepNs = 500'000;
    for (int step = 0; step < 9800; ++step) {
      const TimeNs now = kStart + step * kStepNs;
      const auto due = [step](double rate) {
        return std::floor(step * rate / 2e3) != std::floor((step - 1) * rate / 2e3);
      };
      if (with_imu && due(imu_hz)) {
        addImu(samples, origin + step * kStepNs, now, imu_jitter_s * scatter(random), step, &doctor);
      }
      if (with_camera && due(camera_hz)) {
        const TimeNs stamp = now + toNs(camera_ahead_s) - (repeat_stamps ? step % 1000 * kStepNs : 0);
        doctor.addImage(stamp - 20'000'000 + toNs(camera_jitter_s * scatter(random)), now);
      }
      if (with_lidar && due(lidar_hz)) {
        const TimeNs stamp = now - 110'000'000 + toNs(lidar_ahead_s + lidar_jitter_s * scatter(random));
        doctor.addSweep(stamp, now, span_s);
      }
    }
    return doctor.findings();
  }

 private:
  void addImu(const std::vector<ImuSample>& samples, TimeNs at, TimeNs now, double jitter_s, int step,
              InputDoctor* doctor) const {
    if (lose_every > 0 && step / 5 % lose_every == 0) return;
    const auto found = std::lower_bound(samples.begin(), samples.end(), at,
                                        [](const ImuSample& sample, TimeNs stamp) { return sample.stamp < stamp; });
    ImuSample sample = found == samples.end() ? samples.back() : *found;
    sample.stamp = now - 2'000'000 + toNs(jitter_s);
    sample.gyro *= gyro_scale * (mirrored_gyro ? -1.0 : 1.0);
    sample.gyro = sample.gyro.cwiseMax(-gyro_limit).cwiseMin(gyro_limit);
    if (no_gravity) sample.accel -= 9.81 * sample.accel.normalized();
    sample.accel *= accel_scale;
    doctor->addImu(sample, now);
  }
};

/// Exactly this finding, with these words in its remedy.
void expectOnly(const std::vector<Finding>& findings, const std::string& check, const std::string& remedy) {
  for (const Finding& finding : findings) EXPECT_EQ(finding.check, check) << finding.words();
  ASSERT_FALSE(findings.empty()) << check;
  EXPECT_NE(findings.front().remedy.find(remedy), std::string::npos) << findings.front().remedy;
}

TEST(InputDoctor, FindsNothingWrongWithGoodData) {
  for (const sim::Motion motion : {sim::Motion::kFull, sim::Motion::kStatic, sim::Motion::kPlanar,
                                   sim::Motion::kTranslationOnly, sim::Motion::kRotationOnly}) {
    Recording recording;
    recording.motion = motion;
    const std::vector<Finding> findings = recording.examine();
    EXPECT_TRUE(findings.empty()) << "motion " << static_cast<int>(motion) << ": " << findings.front().words();
  }
}

TEST(InputDoctor, NamesAccelerationInG) {
  Recording recording;
  recording.accel_scale = 1.0 / 9.80665;
  expectOnly(recording.examine(), "imu acceleration unit", "9.80665");
  recording.motion = sim::Motion::kStatic;
  expectOnly(recording.examine(), "imu acceleration unit", "9.80665");
}

TEST(InputDoctor, NamesAccelerationInMilliG) {
  Recording recording;
  recording.accel_scale = 1000.0 / 9.80665;
  expectOnly(recording.examine(), "imu acceleration unit", "0.00980665");
}

TEST(InputDoctor, NamesMissingGravity) {
  Recording recording;
  recording.no_gravity = true;
  recording.motion = sim::Motion::kStatic;
  expectOnly(recording.examine(), "imu acceleration unit", "raw specific force");
}

TEST(InputDoctor, NamesRatesInDegrees) {
  for (const sim::Motion motion : {sim::Motion::kFull, sim::Motion::kRotationOnly}) {
    Recording recording;
    recording.gyro_scale = 180.0 / M_PI;
    recording.motion = motion;
    expectOnly(recording.examine(), "imu rotation unit", "0.0174533");
  }
}

TEST(InputDoctor, NamesAxesThatDoNotAgree) {
  Recording recording;
  recording.mirrored_gyro = true;
  expectOnly(recording.examine(), "imu axes", "right-handed");
}

TEST(InputDoctor, NamesSaturation) {
  Recording recording;
  recording.gyro_limit = 1.1;
  expectOnly(recording.examine(), "imu gyroscope range", "wider range");
}

TEST(InputDoctor, NamesSaturationOfTheAccelerometer) {
  // At rest, with a blow of 50 m/s^2 every half a second, of which 2 g are shown.
  InputDoctor doctor({"/imu", "", ""});
  for (int i = 0; i < 2000; ++i) {
    ImuSample sample;
    sample.stamp = kStart + i * 2'500'000LL;
    const double blow = i % 200 < 20 ? 50.0 * std::sin(M_PI * (i % 200) / 20.0) : 0.0;
    sample.accel = {std::min(blow, 19.6), 0.0, 9.81};
    doctor.addImu(sample, sample.stamp);
  }
  expectOnly(doctor.findings(), "imu accelerometer range", "wider range");
}

TEST(InputDoctor, NamesSlowImu) {
  Recording recording;
  recording.imu_hz = 40.0;
  expectOnly(recording.examine(), "imu rate", "raise the rate");
}

TEST(InputDoctor, NamesFastImu) {
  InputDoctor doctor({"/imu", "", ""});
  for (int i = 0; i < 20000; ++i) {
    ImuSample sample;
    sample.stamp = kStart + i * 250'000LL;
    sample.accel.z() = 9.81;
    doctor.addImu(sample, sample.stamp);
  }
  expectOnly(doctor.findings(), "imu rate", "lower the rate");
}

TEST(InputDoctor, NamesSlowCameraAndLidar) {
  for (const double rate_hz : {1.0, 2.5}) {
    Recording camera, lidar;
    camera.camera_hz = rate_hz;
    expectOnly(camera.examine(), "camera rate", "raise the rate");
    lidar.lidar_hz = rate_hz;
    lidar.span_s = 1.0 / rate_hz;
    expectOnly(lidar.examine(), "lidar rate", "raise the rate of revolution");
  }
}

TEST(InputDoctor, NamesJitter) {
  Recording imu, camera, lidar;
  imu.imu_jitter_s = 0.9e-3;
  expectOnly(imu.examine(), "imu jitter", "sensor's own clock");
  camera.camera_jitter_s = 0.015;
  expectOnly(camera.examine(), "camera jitter", "sensor's own clock");
  lidar.lidar_jitter_s = 0.03;
  expectOnly(lidar.examine(), "lidar jitter", "sensor's own clock");
}

TEST(InputDoctor, NamesLosses) {
  Recording recording;
  recording.lose_every = 7;
  expectOnly(recording.examine(), "imu losses", "queues");
}

TEST(InputDoctor, NamesStampsThatRunBackwards) {
  Recording recording;
  recording.repeat_stamps = true;
  const std::vector<Finding> findings = recording.examine();
  EXPECT_TRUE(std::any_of(findings.begin(), findings.end(),
                          [](const Finding& finding) { return finding.check == "camera stamps"; }));
}

TEST(InputDoctor, TellsSecondsFromEpochs) {
  Recording recording;
  recording.camera_ahead_s = -2.5;
  expectOnly(recording.examine(), "camera clock", "chrony");
  recording.camera_ahead_s = -0.9;  // as pictures are on a machine that is too slow
  const auto late = recording.examine();
  expectOnly(late, "camera clock", "load of the machine");
  EXPECT_NE(late.front().problem.find("come late"), std::string::npos) << late.front().problem;
  recording.camera_ahead_s = -1.7e9 + 100.0;
  const std::vector<Finding> epochs = recording.examine();
  expectOnly(epochs, "camera clock", "host's time");
  EXPECT_NE(epochs.front().problem.find("53.9 years behind"), std::string::npos) << epochs.front().problem;
  recording.camera_ahead_s = 0.0;
  recording.lidar_ahead_s = 37.0;  // TAI against UTC
  expectOnly(recording.examine(), "lidar clock", "chrony");
}

// The gap in the stamps is no loss, and one wrong stamp sets no clock.
TEST(InputDoctor, NamesAClockThatIsSetAhead) {
  InputDoctor doctor({"", "/camera", "/lidar"});
  for (int tenth = 0; tenth < 80; ++tenth) {
    const TimeNs now = kStart + tenth * 100'000'000LL;
    const TimeNs set = tenth > 40 ? 60'000'000'000LL : 0, wrong = tenth == 30 ? 3600'000'000'000LL : 0;
    doctor.addImage(now + set, now);
    doctor.addSweep(now + wrong, now, 0.1);
  }
  ASSERT_EQ(doctor.findings().size(), 1U);
  EXPECT_EQ(doctor.findings().front().problem, "/camera: its clock was set ahead by 60 s");
}

TEST(InputDoctor, NamesPointTimesOfAnotherUnit) {
  Recording recording;
  recording.span_s = 100.0;
  expectOnly(recording.examine(), "point times", "point_time: unit");
  recording.span_s = 1e-4;
  expectOnly(recording.examine(), "point times", "point_time: unit");
  recording.span_s = 0.0;
  expectOnly(recording.examine(), "point times", "field: none");
}

TEST(InputDoctor, NamesPackets) {
  Recording recording;
  recording.lidar_hz = 500.0;
  recording.span_s = 0.002;
  expectOnly(recording.examine(), "lidar rate", "whole revolutions");
}

TEST(InputDoctor, NamesASilentSensor) {
  Recording imu, camera, lidar;
  imu.with_imu = false;
  expectOnly(imu.examine(), "imu silent", "imu: topic");
  camera.with_camera = false;
  expectOnly(camera.examine(), "camera silent", "camera: topic");
  lidar.with_lidar = false;
  expectOnly(lidar.examine(), "lidar silent", "lidar: topic");
}

TEST(InputDoctor, ComparesSizesAndFrames) {
  InputDoctor doctor({"/imu", "/camera", "/lidar"});
  doctor.compareSizes(752, 480, 752, 480);
  doctor.compareFrames("imu", "/imu", "imu_link", "imu_link");
  doctor.compareFrames("imu", "/imu", "/imu_link", "imu_link");
  EXPECT_TRUE(doctor.findings().empty());
  doctor.compareSizes(376, 240, 752, 480);
  doctor.compareFrames("lidar", "/lidar", "velodyne", "lidar_link");
  ASSERT_EQ(doctor.findings().size(), 2U);
  EXPECT_NE(doctor.findings()[0].remedy.find("0.5"), std::string::npos);
  EXPECT_NE(doctor.findings()[1].words().find("velodyne"), std::string::npos);
}

TEST(InputDoctor, SaysEverythingOnce) {
  InputDoctor doctor({"/imu", "", ""});
  doctor.report({"board size", "another board", "correct it"});
  doctor.report({"board size", "another board again", "correct it"});
  EXPECT_EQ(doctor.takeNew().size(), 1U);
  EXPECT_TRUE(doctor.takeNew().empty());
  doctor.restart();
  EXPECT_EQ(doctor.findings().size(), 1U);
}

}  // namespace
}  // namespace cocalib
