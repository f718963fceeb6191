#include "cocalib/io/result_file.h"

#include <dirent.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <limits>
#include <locale>
#include <random>
#include <sstream>

namespace cocalib {
namespace {

/// A directory of its own for every test, removed with all it holds.
class ResultFile : public testing::Test {
 protected:
  void SetUp() override {
    char pattern[] = "/tmp/cocalib_result_XXXXXX";
    directory_ = ::mkdtemp(pattern);
  }
  void TearDown() override {
    for (const std::string& name : entries()) ::unlink((directory_ + "/" + name).c_str());
    ::rmdir(directory_.c_str());
  }
  std::vector<std::string> entries() const {
    std::vector<std::string> names;
    DIR* handle = ::opendir(directory_.c_str());
    while (const dirent* entry = ::readdir(handle)) {
      const std::string name = entry->d_name;
      if (name != "." && name != "..") names.push_back(name);
    }
    ::closedir(handle);
    return names;
  }
  std::string path() const { return directory_ + "/calibration.yaml"; }
  static std::string read(const std::string& path) {
    std::ifstream file(path);
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  }

  std::string directory_;
};

CalibrationEstimate someEstimate() {
  std::mt19937 random(9);
  std::normal_distribution<double> normal;
  CalibrationEstimate e;
  e.status = Status::kConverging;
  e.stamp = 1700000060123456789;
  e.duration_s = 60.1;
  e.calibration.T_imu_camera = {expSo3({0.4, -1.1, 2.3}), {0.3, -0.2, 1.0 / 3.0}};
  e.calibration.T_imu_lidar = {expSo3({-1.7, 0.2, 0.9}), {0.1, 0.3, -0.25}};
  e.calibration.camera_time_offset_s = -0.0123;
  e.calibration.lidar_time_offset_s = 1e-9 / 7.0;
  Matrix14d A;
  for (int i = 0; i < A.size(); ++i) A.data()[i] = 1e-4 * normal(random);
  e.covariance = A * A.transpose();
  for (SensorVerdict* verdict : {&e.camera, &e.lidar, &e.lidar_camera}) {
    verdict->valid = true;
    for (int i = 0; i < 6; ++i) verdict->sigma[i] = std::abs(normal(random)) * 1e-3;
    verdict->time_offset_sigma_s = 1.23456789012345678e-5;
  }
  e.camera.unobservable = {"translation along imu z: no rotation about x or y yet", "say \"so\" \\ : {x}"};
  e.lidar.sigma[2] = std::numeric_limits<double>::infinity();
  e.gyro_bias = {1e-3, -2e-3, 1.0 / 7.0};
  e.accel_bias = {0.01, 0.02, -0.03};
  e.gravity = 9.81;
  e.quality = {0.31, 0.021, 17, 12345, 678};
  e.message = "turn about x # or y";
  return e;
}

void expectSameVerdict(const SensorVerdict& a, const SensorVerdict& b) {
  EXPECT_EQ(a.valid, b.valid);
  EXPECT_EQ(a.sigma, b.sigma);
  EXPECT_EQ(a.time_offset_sigma_s, b.time_offset_sigma_s);
  EXPECT_EQ(a.unobservable, b.unobservable);
}

TEST_F(ResultFile, RoundTripKeepsEveryBit) {
  const CalibrationEstimate written = someEstimate();
  writeFileAtomically(path(), formatResult(written, {}));
  const CalibrationEstimate read = loadResult(path());
  EXPECT_EQ(read.status, written.status);
  EXPECT_EQ(read.stamp, written.stamp);
  EXPECT_EQ(read.duration_s, written.duration_s);
  EXPECT_EQ(read.message, written.message);
  EXPECT_EQ(read.calibration.T_imu_camera.t, written.calibration.T_imu_camera.t);
  EXPECT_EQ(read.calibration.T_imu_camera.q.coeffs(), written.calibration.T_imu_camera.q.coeffs());
  EXPECT_EQ(read.calibration.T_imu_lidar.t, written.calibration.T_imu_lidar.t);
  EXPECT_EQ(read.calibration.T_imu_lidar.q.coeffs(), written.calibration.T_imu_lidar.q.coeffs());
  EXPECT_EQ(read.calibration.camera_time_offset_s, written.calibration.camera_time_offset_s);
  EXPECT_EQ(read.calibration.lidar_time_offset_s, written.calibration.lidar_time_offset_s);
  EXPECT_EQ(read.covariance, written.covariance);
  expectSameVerdict(read.camera, written.camera);
  expectSameVerdict(read.lidar, written.lidar);
  expectSameVerdict(read.lidar_camera, written.lidar_camera);
  EXPECT_EQ(read.gyro_bias, written.gyro_bias);
  EXPECT_EQ(read.accel_bias, written.accel_bias);
  EXPECT_EQ(read.gravity, written.gravity);
  EXPECT_EQ(read.quality.board_lidar_points, written.quality.board_lidar_points);
  EXPECT_EQ(formatResult(read, {}), formatResult(written, {}));
}

TEST_F(ResultFile, KeysAreThoseOfTheContract) {
  const std::string text = formatResult(someEstimate(), {});
  std::size_t at = 0;
  for (const char* key : {"cocalib: 1\n",
                          "status: converging\n",
                          "stamp: 1700000060.123456789",
                          "duration: 60.1",
                          "camera:\n",
                          "  T_imu_camera: {translation: [",
                          "rotation_xyzw: [",
                          "  time_offset: -0.0123",
                          "  sigma: {translation: [",
                          "rotation: [",
                          "time_offset: ",
                          "  unobservable: [",
                          "lidar:\n",
                          "  T_imu_lidar: {",
                          "lidar_camera:\n",
                          "  T_lidar_camera: {",
                          "imu: {gyroscope_bias: [",
                          "accelerometer_bias: [",
                          "gravity: 9.81",
                          "joint_covariance:\n",
                          "quality: {",
                          "reprojection_rms_px: 0.31",
                          "lidar_plane_rms_m: 0.021",
                          "board_views: 17",
                          "board_lidar_points: 12345",
                          "keyframes: 678"}) {
    at = text.find(key, at);
    ASSERT_NE(at, std::string::npos) << key << "\n" << text;
  }
}

TEST_F(ResultFile, WhatTheRigLacksIsLeftOut) {
  const std::string camera_only = formatResult(someEstimate(), {true, false});
  EXPECT_EQ(camera_only.find("lidar:\n"), std::string::npos);
  EXPECT_EQ(camera_only.find("lidar_camera"), std::string::npos);
  writeFileAtomically(path(), camera_only);
  EXPECT_TRUE(loadResult(path()).camera.valid);
  EXPECT_FALSE(loadResult(path()).lidar.valid);

  CalibrationEstimate nothing;
  const std::string text = formatResult(nothing, {});
  EXPECT_NE(text.find("status: insufficient_data"), std::string::npos);
  EXPECT_EQ(text.find("T_imu"), std::string::npos);
  writeFileAtomically(path(), text);
  EXPECT_EQ(loadResult(path()).status, Status::kInsufficientData);
}

TEST_F(ResultFile, StampsKeepTheirNanoseconds) {
  for (const TimeNs stamp : {TimeNs{0}, TimeNs{1}, TimeNs{-1}, TimeNs{999999999}, TimeNs{-1500000000},
                             TimeNs{1700000060000000001}, TimeNs{9223372035999999999}}) {
    CalibrationEstimate estimate;
    estimate.stamp = stamp;
    writeFileAtomically(path(), formatResult(estimate, {}));
    EXPECT_EQ(loadResult(path()).stamp, stamp);
  }
}

struct DecimalComma : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST_F(ResultFile, ALocaleWithDecimalCommasChangesNothing) {
  const std::string text = formatResult(someEstimate(), {});
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new DecimalComma));
  const std::string in_locale = formatResult(someEstimate(), {});
  writeFileAtomically(path(), text);
  const double third = loadResult(path()).calibration.T_imu_camera.t.z();
  std::locale::global(before);
  EXPECT_EQ(in_locale, text);
  EXPECT_EQ(third, 1.0 / 3.0);
}

TEST_F(ResultFile, RefusesToReadWhatIsDamaged) {
  const std::string good = formatResult(someEstimate(), {});
  const auto refusal = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    std::ofstream(path()) << text;
    try {
      loadResult(path());
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_NE(refusal("cocalib: 1", "cocalib: 2").find("'cocalib' = 2"), std::string::npos);
  EXPECT_NE(refusal("converging", "done").find("'status' = done"), std::string::npos);
  EXPECT_NE(refusal("1700000060.1", "x.1").find("'stamp'"), std::string::npos);
  EXPECT_NE(refusal("T_imu_camera", "T_camera_imu").find("'camera: T_imu_camera': is missing"), std::string::npos);
  EXPECT_NE(refusal("gravity", "gravitation").find("'imu: gravity': is missing"), std::string::npos);
  EXPECT_NE(refusal("  - [", "  - [0, ").find("14 rows"), std::string::npos);
  EXPECT_NE(refusal("quality: {", "quality: [").find("no valid YAML"), std::string::npos);
  EXPECT_THROW(loadResult(directory_ + "/absent.yaml"), std::runtime_error);
}

TEST_F(ResultFile, WritingReplacesTheOldFileAndLeavesNothingElse) {
  writeFileAtomically(path(), "old");
  writeFileAtomically(path(), "new and longer");
  EXPECT_EQ(read(path()), "new and longer");
  EXPECT_EQ(entries().size(), 1U);
  struct stat status {};
  ::stat(path().c_str(), &status);
  const mode_t mask = ::umask(0);
  ::umask(mask);
  EXPECT_EQ(status.st_mode & 0777U, 0666U & ~mask);
}

// A limit on file sizes stands for the full disk: the write fails half way.
TEST_F(ResultFile, AFullDiskLeavesTheOldFileUntouched) {
  writeFileAtomically(path(), "the last good result");
  rlimit before{};
  ::getrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{1000, before.rlim_max};
  ::setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_THROW(writeFileAtomically(path(), std::string(100000, 'x')), std::runtime_error);
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(read(path()), "the last good result");
  EXPECT_EQ(entries().size(), 1U);
}

TEST_F(ResultFile, SaysWhichFileCannotBeWritten) {
  const std::string absent = directory_ + "/absent/calibration.yaml";
  try {
    writeFileAtomically(absent, "x");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find(absent), std::string::npos);
  }
}

}  // namespace
}  // namespace cocalib
