// What the user is told to do while the rig is moved on a flat floor, and when it is tilted at last.
#include "calibrators/degenerate_motion.h"
#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/monitor/coverage.h"
#include "cocalib/monitor/progress.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

constexpr int kEveryFifth = 5;  // of 50 pictures per second

/// All three calibrators behind one another, fed in the order of time; the corners and tracks come without pictures.
class WatchedRun {
 public:
  explicit WatchedRun(const sim::Scenario& s)
      : s_(s),
        scene_(s),
        trajectory_(s),
        tracks_(s, scene_, trajectory_),
        imu_(sim::simulateImu(s, trajectory_)),
        camera_(VisualInertialParams(), test::noiseOf(s), s.camera.cameraModel(), s.board.geometry(), std::nullopt),
        lidar_(LidarInertialParams(), test::noiseOf(s), std::nullopt),
        fuser_(FuserParams(), test::noiseOf(s), {s.camera.cameraModel(), true, s.board.geometry()}) {}

  /// The next tenth of a second.
  void step() {
    const TimeNs end = s_.epoch + toNs(0.1 * ++tenths_);
    for (; next_imu_ < imu_.size() && imu_[next_imu_].stamp <= end; ++next_imu_) {
      camera_.addImu(imu_[next_imu_]);
      lidar_.addImu(imu_[next_imu_]);
      fuser_.addImu(imu_[next_imu_]);
      motion_.add(imu_[next_imu_]);
    }
    addPicture(kEveryFifth * (tenths_ - 1));
    if (tenths_ <= sim::scanCount(s_)) {
      for (LidarKeyframe& keyframe : lidar_.addScan(sim::simulateScan(s_, scene_, trajectory_, tenths_ - 1).scan)) {
        fuser_.addLidar(std::move(keyframe));
      }
    }
    fuser_.setVisualEstimate(camera_.estimate());
    fuser_.setLidarEstimate(lidar_.estimate());
    if (fuser_.wantsSolve()) fuser_.solve();
  }
  double time_s() const { return 0.1 * tenths_; }
  CalibrationEstimate estimate() const { return fuser_.estimate(); }
  std::optional<MotionHint> hint() const {
    return adviseMotion(fuser_.estimate(), motion_.turned_rad(), ObservabilityThresholds());
  }

 private:
  void addPicture(int k) {
    if (k >= sim::imageCount(s_)) return;
    VisualKeyframe seen;
    seen.stamp = sim::imageStamp(s_, k);
    seen.board = sim::simulateBoard(s_, scene_, trajectory_, k);
    seen.tracks = tracks_.observe(k);
    for (VisualKeyframe& keyframe : camera_.addMeasurements(std::move(seen))) fuser_.addVisual(std::move(keyframe));
  }

  const sim::Scenario s_;
  const sim::Scene scene_;
  const sim::Trajectory trajectory_;
  sim::TrackSimulator tracks_;
  const std::vector<ImuSample> imu_;
  VisualInertialCalibrator camera_;
  LidarInertialCalibrator lidar_;
  CoCalibrationFuser fuser_;
  MotionCoverage motion_;
  std::size_t next_imu_ = 0;
  int tenths_ = 0;
};

TEST(MotionHint, NamesTheMissingRotationUntilTheRigIsTilted) {
  sim::Scenario s = sim::loadScenario("cfg/scenarios/planar_then_full.yaml");
  s.duration_s = s.planar_for_s + 7.0;
  constexpr double kLatestS = 4.0;  // after the tilting began: it swells for 1.5 s, and solves come once a second
  WatchedRun run(s);
  int named = 0, changes = 0;
  std::optional<MotionHint> last;
  while (run.time_s() < s.duration_s - 0.2) {
    run.step();
    const double t = run.time_s();
    const std::optional<MotionHint> hint = run.hint();
    if (t > s.planar_for_s + kLatestS) {
      EXPECT_FALSE(hint) << t << " s: " << hint->words;
      EXPECT_EQ(run.estimate().status, Status::kConverged) << t << " s: " << run.estimate().message;
    }
    if (t > s.planar_for_s) continue;
    ASSERT_TRUE(hint) << t;
    EXPECT_EQ(hint->axis_I.z(), 0.0) << t << " s: " << hint->words;
    changes += last && last->axis_I != hint->axis_I ? 1 : 0;
    last = hint;
    if (!run.estimate().camera.valid) continue;
    ++named;
    EXPECT_NE(hint->words.find("translation along imu z does not show yet"), std::string::npos) << hint->words;
  }
  EXPECT_GT(named, 20);   // more than two seconds
  EXPECT_EQ(changes, 0);  // nobody can follow advice that changes every second
}

}  // namespace
}  // namespace cocalib
