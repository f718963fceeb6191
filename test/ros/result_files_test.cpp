#include "cocalib/ros/result_files.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "cocalib/io/result_file.h"

namespace cocalib {
namespace {

namespace fs = std::filesystem;

class ResultFiles : public testing::Test {
 protected:
  void SetUp() override {
    char pattern[] = "/tmp/cocalib_result_files_XXXXXX";
    parent_ = ::mkdtemp(pattern);
    output_ = parent_ + "/run/output";
    rig_.imu = {"/imu", "imu", {}};
    rig_.lidar = RigConfig::Lidar();
    result_.estimate.status = Status::kConverging;
    result_.estimate.lidar.valid = true;
    result_.log.add(result_.estimate);
    prepareOutputDirectory(output_);
  }
  void TearDown() override {
    fs::permissions(parent_, fs::perms::owner_all);
    fs::remove_all(parent_);
  }
  CalibrationEstimate written() const { return loadResult(output_ + "/calibration.yaml"); }

  std::string parent_, output_;
  RigConfig rig_;
  RunResult result_;
};

TEST_F(ResultFiles, AVanishedDirectoryIsMadeAgain) {
  fs::remove_all(parent_ + "/run");
  writeResultFiles(output_, rig_, result_);
  EXPECT_TRUE(written().lidar.valid);
  EXPECT_TRUE(fs::exists(output_ + "/report.html"));
}

TEST_F(ResultFiles, OneLineSaysWhyNothingIsWritten) {
  writeResultFiles(output_, rig_, result_);
  result_.estimate.status = Status::kConverged;
  fs::permissions(output_, fs::perms{0555});
  fs::permissions(parent_, fs::perms{0755});
  const bool root = ::geteuid() == 0;  // whom permissions do not bind
  ASSERT_EQ(root ? ::seteuid(65534) : 0, 0);
  std::string words;
  try {
    writeResultFiles(output_, rig_, result_);
  } catch (const std::runtime_error& error) {
    words = error.what();
  }
  ASSERT_EQ(root ? ::seteuid(0) : 0, 0);
  EXPECT_NE(words.find(output_), std::string::npos) << words;
  EXPECT_NE(words.find("cannot be written"), std::string::npos) << words;
  EXPECT_EQ(words.find('\n'), std::string::npos);
  EXPECT_EQ(written().status, Status::kConverging);
}

}  // namespace
}  // namespace cocalib
