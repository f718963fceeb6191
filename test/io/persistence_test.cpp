// What is on the disk after a process was killed, or could not write.

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <random>

#include "cocalib/io/result_file.h"

namespace cocalib {
namespace {

namespace fs = std::filesystem;

constexpr int kKills = 200;

/// A directory of its own for every test, removed with all it holds.
class Persistence : public testing::Test {
 protected:
  void SetUp() override {
    char pattern[] = "/tmp/cocalib_persistence_XXXXXX";
    directory_ = ::mkdtemp(pattern);
  }
  void TearDown() override {
    fs::permissions(directory_, fs::perms::owner_all);
    fs::remove_all(directory_);
  }
  std::string path() const { return directory_ + "/calibration.yaml"; }
  std::size_t entries() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(directory_), fs::directory_iterator()));
  }
  /// The words with which writing `text` to path() is refused; empty if it is not.
  std::string refusal(const std::string& text) const {
    try {
      writeFileAtomically(path(), text);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }
  std::string content() const {
    std::ifstream file(path());
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  std::string directory_;
};

/// Result number `count`: it differs from every other one, also in its length.
std::string result(int count) {
  CalibrationEstimate estimate;
  estimate.status = Status::kConverging;
  estimate.message = std::string(static_cast<std::size_t>(count % 7) * 1000, 'x');
  estimate.camera.valid = estimate.lidar.valid = estimate.lidar_camera.valid = true;
  estimate.camera.sigma.setConstant(1e-3);
  estimate.lidar.sigma = estimate.lidar_camera.sigma = estimate.camera.sigma;
  estimate.covariance.setIdentity();
  estimate.quality.keyframes = count;
  return formatResult(estimate, {});
}

TEST_F(Persistence, TwoHundredKillsLeaveTheNewestOrThePreviousResult) {
  // Number of the last result whose writing has returned; shared with the process that is killed.
  void* const shared =
      ::mmap(nullptr, sizeof(std::atomic<int>), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(shared, MAP_FAILED);
  auto* const written = new (shared) std::atomic<int>(0);
  writeFileAtomically(path(), result(0));

  std::mt19937 random(7);
  std::uniform_int_distribution<int> delay_us(0, 8000);
  int killed_while_writing = 0;
  for (int kill = 0; kill < kKills; ++kill) {
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      for (int count = *written + 1;; ++count) {
        writeFileAtomically(path(), result(count));
        *written = count;
      }
    }
    ::usleep(static_cast<useconds_t>(delay_us(random)));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);

    const std::size_t left_over = entries() - 1;
    ASSERT_LE(left_over, 1U);  // the next process has swept what the one before left
    if (left_over == 1) ++killed_while_writing;
    const CalibrationEstimate read = loadResult(path());
    ASSERT_GE(read.quality.keyframes, *written);
    ASSERT_LE(read.quality.keyframes, *written + 1);
    ASSERT_EQ(content(), result(read.quality.keyframes));
    *written = read.quality.keyframes;
  }
  EXPECT_GT(*written, 0);
  EXPECT_GT(killed_while_writing, 0) << "no kill fell into a write: the test has shown nothing";
  writeFileAtomically(path(), result(*written + 1));
  EXPECT_EQ(entries(), 1U);
  ::munmap(shared, sizeof(std::atomic<int>));
}

TEST_F(Persistence, SweepsWhatWasLeftOverAndNothingElse) {
  for (const char* name : {".calibration.yaml.cocalib-a1B2c3", ".report.html.cocalib-ZZZZZZ"}) {
    std::ofstream(directory_ + "/" + name) << "half of a res";
  }
  for (const char* name :
       {"calibration.yaml.backup", "calibration.yaml.cocalib-a1B2c3", ".cocalib-a1B2c3", ".hidden"}) {
    std::ofstream(directory_ + "/" + name) << "the user's own";
  }
  writeFileAtomically(path(), "result");
  EXPECT_EQ(entries(), 5U);
  EXPECT_FALSE(fs::exists(directory_ + "/.calibration.yaml.cocalib-a1B2c3"));
  EXPECT_FALSE(fs::exists(directory_ + "/.report.html.cocalib-ZZZZZZ"));
}

// Whoever sweeps must not take the file that another is writing to.
TEST_F(Persistence, TwoProcessesWriteBesideEachOther) {
  constexpr int kTimes = 300;
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  const std::string own = directory_ + (child == 0 ? "/report.html" : "/calibration.yaml");
  bool good = true;
  for (int i = 0; i < kTimes && good; ++i) {
    try {
      writeFileAtomically(own, result(i));
    } catch (const std::exception&) {
      good = false;
    }
  }
  if (child == 0) ::_exit(good ? 0 : 1);
  EXPECT_TRUE(good);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  EXPECT_EQ(entries(), 2U);
}

TEST_F(Persistence, AReadOnlyDirectoryKeepsTheLastResult) {
  writeFileAtomically(path(), "the last good result");
  ::chmod(directory_.c_str(), 0555);
  const bool root = ::geteuid() == 0;  // whom permissions do not bind
  ASSERT_EQ(root ? ::seteuid(65534) : 0, 0);
  const std::string words = refusal("new");
  ASSERT_EQ(root ? ::seteuid(0) : 0, 0);
  EXPECT_NE(words.find(path() + ": cannot create a file beside it: Permission denied"), std::string::npos) << words;
  EXPECT_EQ(content(), "the last good result");
}

TEST_F(Persistence, SaysThatTheDirectoryHasVanished) {
  writeFileAtomically(path(), "the last good result");
  fs::remove_all(directory_);
  const std::string words = refusal("new");
  EXPECT_NE(words.find(path()), std::string::npos) << words;
  EXPECT_NE(words.find("No such file or directory"), std::string::npos) << words;
  fs::create_directory(directory_);
  EXPECT_EQ(refusal("new"), "");
  EXPECT_EQ(content(), "new");
}

TEST_F(Persistence, AFullDiskKeepsTheLastResult) {
  if (::mount("tmpfs", directory_.c_str(), "tmpfs", 0, "size=64k") != 0) {
    GTEST_SKIP() << "no right to mount a small disk; a limit on file sizes stands for it in result_file_test";
  }
  writeFileAtomically(path(), "the last good result");
  const std::string words = refusal(std::string(200000, 'x'));
  const std::string kept = content();
  const std::size_t files = entries();
  ::umount(directory_.c_str());
  EXPECT_NE(words.find("No space left on device"), std::string::npos) << words;
  EXPECT_EQ(kept, "the last good result");
  EXPECT_EQ(files, 1U);
}

}  // namespace
}  // namespace cocalib
