#include "cocalib/visual/two_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "cocalib/geometry/so3.h"
#include "cocalib/visual/feature_tracker.h"

namespace cocalib {
namespace {

const CameraModel kCamera(CameraModel::Distortion::kRadTan, {458.0, 457.0, 367.0, 248.0},
                          {-0.283, 0.0739, 0.0002, 1.7e-5}, 752, 480);
const double kPx = 1.0 / kCamera.focalPx();

struct Scene {
  std::vector<TrackObservation> a, b;
  BearingPairs pairs;
};

/// 150 points at 2 to 8 m seen before and after a motion, with noise and a share of outliers.
Scene makeScene(const Eigen::Quaterniond& R_b_a, const Eigen::Vector3d& t_b_a, double noise_px, double outliers,
                std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::normal_distribution<double> noise(0.0, noise_px);
  Scene scene;
  for (std::uint32_t id = 0; scene.a.size() < 150; ++id) {
    const Eigen::Vector2d px(20.0 + 712.0 * unit(random), 20.0 + 440.0 * unit(random));
    const Eigen::Vector3d p_a = *kCamera.unproject(px) * (2.0 + 6.0 * unit(random));
    const auto px_b = kCamera.project(R_b_a * p_a + t_b_a);
    if (!px_b || !kCamera.inImage(*px_b, 5.0)) continue;
    Eigen::Vector2d seen = *px_b + Eigen::Vector2d(noise(random), noise(random));
    if (unit(random) < outliers) seen += Eigen::Vector2d(40.0 * unit(random) - 20.0, 40.0 * unit(random) - 20.0);
    scene.a.push_back({id, (px + Eigen::Vector2d(noise(random), noise(random))).cast<float>()});
    scene.b.push_back({id, seen.cast<float>()});
    const auto bearing_b = kCamera.unproject(seen);
    if (!bearing_b) continue;
    scene.pairs.a.push_back(*kCamera.unproject(scene.a.back().px.cast<double>()));
    scene.pairs.b.push_back(*bearing_b);
  }
  return scene;
}

const Eigen::Quaterniond kR_b_a = expSo3({0.05, -0.08, 0.06});
const Eigen::Vector3d kT_b_a(0.12, -0.05, 0.08);

TEST(EpipolarError, IsZeroOnExactPairsAndSignedDistanceElsewhere) {
  const TwoViewMotion motion{Eigen::Quaterniond::Identity(), Eigen::Vector3d::UnitX()};
  const Eigen::Vector3d a = Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(epipolarError(motion, a, Eigen::Vector3d(0.3, 0.0, 1.0).normalized()), 0.0, 1e-15);
  // Off the epipolar plane by 1 mrad in b alone: the least joint correction shares it between a and b.
  EXPECT_NEAR(std::abs(epipolarError(motion, a, Eigen::Vector3d(0.0, 0.001, 1.0).normalized())), 0.001 / std::sqrt(2.0),
              1e-8);
}

TEST(RobustRotation, SurvivesOutliers) {
  const Scene scene = makeScene(kR_b_a, Eigen::Vector3d::Zero(), 0.3, 0.4, 3);
  const auto R = robustRotation(scene.pairs, 2.0 * kPx);
  ASSERT_TRUE(R);
  EXPECT_LT(R->angularDistance(kR_b_a), 0.5e-3);
}

TEST(RobustTranslation, FindsTheDirectionUnderAKnownRotation) {
  const Scene scene = makeScene(kR_b_a, kT_b_a, 0.3, 0.3, 4);
  const auto motion = robustTranslation(scene.pairs, kR_b_a, 1.5 * kPx);
  ASSERT_TRUE(motion);
  EXPECT_GT(std::abs(motion->t_b_a.dot(kT_b_a.normalized())), std::cos(0.15));
}

TEST(RefineMotion, ConvergesOnTheTruth) {
  const Scene scene = makeScene(kR_b_a, kT_b_a, 0.0, 0.0, 5);
  const TwoViewMotion start{expSo3({0.01, -0.01, 0.01}) * kR_b_a, Eigen::Vector3d(0.8, -0.1, 0.8).normalized()};
  double cost = 1.0;
  const TwoViewMotion motion = refineMotion(scene.pairs, start, 0.7 * kPx, &cost);
  EXPECT_LT(motion.R_b_a.angularDistance(kR_b_a), 1e-5);
  EXPECT_NEAR(std::abs(motion.t_b_a.dot(kT_b_a.normalized())), 1.0, 1e-5);
  EXPECT_LT(cost, 1e-3);
}

TEST(RelativeRotation, UnbiasedWithAndWithoutParallax) {
  for (const double parallax : {0.0, 0.02, 0.3, 1.0}) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    constexpr int kRuns = 20;
    std::vector<double> errors;
    for (std::uint32_t seed = 0; seed < kRuns; ++seed) {
      const Scene scene = makeScene(kR_b_a, parallax * kT_b_a, 0.3, 0.15, 10 + seed);
      const auto rotation = relativeRotation(scene.a, scene.b, kCamera);
      ASSERT_TRUE(rotation);
      EXPECT_GT(rotation->inliers, 90);
      const Eigen::Vector3d error = logSo3(rotation->R_b_a * kR_b_a.conjugate());
      errors.push_back(error.norm());
      mean += error / kRuns;
    }
    std::nth_element(errors.begin(), errors.begin() + kRuns / 2, errors.end());
    EXPECT_LT(errors[kRuns / 2], 2e-3) << parallax;
    EXPECT_LT(mean.norm(), 1.5e-3) << parallax;
  }
}

TEST(RelativeRotation, NothingFromTooFewCommonTracks) {
  Scene scene = makeScene(kR_b_a, kT_b_a, 0.3, 0.0, 6);
  scene.b.resize(14);
  EXPECT_FALSE(relativeRotation(scene.a, scene.b, kCamera));
  EXPECT_FALSE(relativeRotation({}, {}, kCamera));
}

TEST(RelativeRotation, OrderOfTracksDoesNotMatter) {
  Scene scene = makeScene(kR_b_a, kT_b_a, 0.3, 0.1, 7);
  const auto first = relativeRotation(scene.a, scene.b, kCamera);
  std::reverse(scene.b.begin(), scene.b.end());
  const auto second = relativeRotation(scene.a, scene.b, kCamera);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->R_b_a.coeffs(), second->R_b_a.coeffs());
}

}  // namespace
}  // namespace cocalib
