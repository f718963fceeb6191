#include "cocalib/lidar/lidar_odometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "cocalib/geometry/so3.h"
#include "cocalib/sim/lidar.h"

namespace cocalib {
namespace {

/// The simulated rig with the true pose of its lidar.
class Rig {
 public:
  explicit Rig(sim::LidarModel model = sim::LidarModel::kVlp16, std::uint64_t seed = 1)
      : scenario_(makeScenario(model, seed)), scene_(scenario_), trajectory_(scenario_) {}

  LidarScan scan(int k) const { return sim::simulateScan(scenario_, scene_, trajectory_, k).scan; }
  Pose T_W_L(TimeNs stamp) const {
    return trajectory_.T_W_I(trajectory_.timeOf(stamp)) * scenario_.lidar.T_imu_lidar();
  }

 private:
  static sim::Scenario makeScenario(sim::LidarModel model, std::uint64_t seed) {
    sim::Scenario scenario;
    scenario.lidar.model = model;
    scenario.seed = seed;
    return scenario;
  }

  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
};

struct Errors {
  double rotation_rms = 0.0;  ///< of the rotation from one sweep's begin to the next one's [rad]
  double position_max = 0.0;  ///< in the frame of the first good sweep [m]
  int good = 0, sweeps = 0;
};

Errors run(const Rig& rig, int first, int count) {
  LidarOdometry odometry{LidarOdometry::Params{}};
  Errors errors;
  double squares = 0.0;
  Pose T_W_M;
  LidarOdometry::Result last;
  for (int k = first; k < first + count; ++k) {
    const LidarOdometry::Result result = odometry.addScan(rig.scan(k));
    ++errors.sweeps;
    if (!result.good) continue;
    const Pose truth = rig.T_W_L(result.begin);
    if (errors.good++ == 0) {
      T_W_M = truth * result.T_M_L_begin.inverse();
    } else {
      const Eigen::Quaterniond relative = last.T_M_L_begin.q.conjugate() * result.T_M_L_begin.q;
      const Eigen::Quaterniond true_relative = rig.T_W_L(last.begin).q.conjugate() * truth.q;
      squares += logSo3(relative * true_relative.conjugate()).squaredNorm();
      errors.position_max = std::max(errors.position_max, (T_W_M * result.T_M_L_begin.t - truth.t).norm());
    }
    last = result;
  }
  errors.rotation_rms = std::sqrt(squares / std::max(1, errors.good - 1));
  return errors;
}

TEST(LidarOdometry, FollowsLivelyMotionFromRest) {
  const Errors errors = run(Rig(), 0, 120);
  EXPECT_EQ(errors.good, errors.sweeps - 1);  // the first one never is
  EXPECT_LT(errors.rotation_rms, 0.005);      // what hand-eye can live with; about 0.0025 is reached
  EXPECT_LT(errors.position_max, 0.05);
}

TEST(LidarOdometry, StartsInFullMotion) {
  for (const int first : {30, 47, 62}) {
    const Errors errors = run(Rig(sim::LidarModel::kVlp16, 2), first, 25);
    EXPECT_GE(errors.good, errors.sweeps - 2) << "first sweep " << first;
    EXPECT_LT(errors.rotation_rms, 0.005) << "first sweep " << first;
  }
}

TEST(LidarOdometry, WorksWithOtherScanPatterns) {
  for (const sim::LidarModel model : {sim::LidarModel::kOs1_64, sim::LidarModel::kXt32, sim::LidarModel::kLivox}) {
    const Errors errors = run(Rig(model), 5, 20);
    EXPECT_GE(errors.good, errors.sweeps - 2) << static_cast<int>(model);
    EXPECT_LT(errors.rotation_rms, 0.006) << static_cast<int>(model);
  }
}

TEST(LidarOdometry, PosesAreContinuousBetweenBeginAndEnd) {
  const Rig rig;
  LidarOdometry odometry{LidarOdometry::Params{}};
  for (int k = 20; k < 30; ++k) {
    const LidarOdometry::Result result = odometry.addScan(rig.scan(k));
    EXPECT_LT((result.at(0.0).minus(result.T_M_L_begin)).norm(), 1e-12);
    EXPECT_LT((result.at(1.0).minus(result.T_M_L_end)).norm(), 1e-12);
    EXPECT_LT(result.begin, result.end);
  }
}

TEST(LidarOdometry, SameSweepsSameBits) {
  const Rig rig;
  LidarOdometry one{LidarOdometry::Params{}}, two{LidarOdometry::Params{}};
  for (int k = 0; k < 5; ++k) two.addScan(rig.scan(k));
  two.reset();  // leaves nothing behind
  for (int k = 10; k < 20; ++k) {
    const LidarScan scan = rig.scan(k);
    const LidarOdometry::Result a = one.addScan(scan), b = two.addScan(scan);
    EXPECT_EQ(a.T_M_L_end.t, b.T_M_L_end.t);
    EXPECT_EQ(a.T_M_L_end.q.coeffs(), b.T_M_L_end.q.coeffs());
    EXPECT_EQ(a.good, b.good);
  }
}

TEST(LidarOdometry, SweepsWithoutTimesAreRegisteredRigidly) {
  const Rig rig;
  LidarOdometry odometry{LidarOdometry::Params{}};
  LidarScan scan = rig.scan(0);  // at rest, so that the missing times do no harm
  for (LidarPoint& point : scan.points) point.offset_s = 0.0F;
  for (int k = 0; k < 10; ++k) {
    scan.stamp += 100000000;
    const LidarOdometry::Result result = odometry.addScan(scan);
    EXPECT_EQ(result.good, k > 0);
    EXPECT_LT(result.T_M_L_begin.minus(Pose{}).norm(), 0.01);
    EXPECT_LT(result.T_M_L_end.minus(Pose{}).norm(), 0.01);
  }
}

TEST(LidarOdometry, PoorSweepsAreNotGoodAndHarmless) {
  const Rig rig;
  LidarOdometry odometry{LidarOdometry::Params{}};
  LidarScan empty;
  EXPECT_FALSE(odometry.addScan(empty).good);
  for (int k = 0; k < 15; ++k) odometry.addScan(rig.scan(k));

  empty.stamp = rig.scan(15).stamp;
  EXPECT_FALSE(odometry.addScan(empty).good);
  LidarScan one = empty;
  one.points.push_back({Eigen::Vector3f(1.0F, 2.0F, 3.0F), 0.0F, 0});
  EXPECT_FALSE(odometry.addScan(one).good);
  LidarScan elsewhere = rig.scan(16);
  for (LidarPoint& point : elsewhere.points) point.p *= 3.0F;
  EXPECT_FALSE(odometry.addScan(elsewhere).good);
  LidarScan broken = rig.scan(17);
  for (std::size_t i = 0; i < broken.points.size(); i += 3) {
    broken.points[i].p.x() = std::numeric_limits<float>::quiet_NaN();
    broken.points[i + 1].p.x() = 1e30F;
  }
  EXPECT_TRUE(odometry.addScan(broken).T_M_L_end.t.allFinite());
  int good = 0;
  for (int k = 18; k < 28; ++k) good += odometry.addScan(rig.scan(k)).good ? 1 : 0;
  EXPECT_GE(good, 9);
}

TEST(LidarOdometry, RefusesImpossibleParameters) {
  LidarOdometry::Params params;
  params.voxel_m = 0.0;
  EXPECT_THROW(LidarOdometry{params}, std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
