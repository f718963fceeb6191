#include "cocalib/visual/patch_alignment.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <random>

namespace cocalib {
namespace {

/// Smooth random picture as a function, so that it can be drawn under any warp without interpolation.
class Clouds {
 public:
  Clouds() {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (Wave& wave : waves_)
      wave = {0.6 * unit(random), 0.6 * unit(random), 3.0 * unit(random),
              9.0};  // bright or dark, never cut off at 0 or 255
  }
  double at(double x, double y) const {
    double sum = 128.0;
    for (const Wave& w : waves_) sum += w.height * std::sin(w.u * x + w.v * y + w.phase);
    return sum;
  }
  /// Picture in which the point x of the original appears at `place`, x counted from (40, 40).
  cv::Mat picture(const PatchPlace& place, double gain = 1.0, double offset = 0.0, double noise = 0.0) const {
    cv::Mat gray(80, 80, CV_8UC1);
    const Eigen::Matrix2d back = place.A.inverse();
    std::mt19937 random(9);
    std::normal_distribution<double> normal;
    for (int row = 0; row < gray.rows; ++row) {
      for (int col = 0; col < gray.cols; ++col) {
        const Eigen::Vector2d x = back * (Eigen::Vector2d(col, row) - place.center) + Eigen::Vector2d(40.0, 40.0);
        gray.at<std::uint8_t>(row, col) =
            cv::saturate_cast<std::uint8_t>(gain * at(x.x(), x.y()) + offset + noise * normal(random));
      }
    }
    return gray;
  }

 private:
  struct Wave {
    double u, v, phase, height;
  };
  Wave waves_[8];
};

const PatchPlace kStraight{{40.0, 40.0}, Eigen::Matrix2d::Identity()};

PatchPlace warped(double x, double y, double turn, double scale) {
  Eigen::Matrix2d A;
  A << std::cos(turn), -std::sin(turn), std::sin(turn), std::cos(turn);
  return {{40.0 + x, 40.0 + y}, scale * A};
}

TEST(ReferencePatch, IsFoundUnderWarpAndChangeOfLight) {
  const Clouds clouds;
  const auto patch = ReferencePatch::cut(clouds.picture(kStraight), kStraight.center);
  ASSERT_TRUE(patch);
  const PatchPlace start = kStraight;
  for (const PatchPlace& truth : {warped(0.3, -0.4, 0.0, 1.0), warped(-1.2, 0.9, 0.1, 1.0),
                                  warped(0.5, 0.5, -0.15, 1.1), warped(1.0, -0.2, 0.05, 0.88)}) {
    for (const double gain : {0.6, 1.0, 1.2}) {
      const auto found = patch->find(clouds.picture(truth, gain, 5.0), start);
      ASSERT_TRUE(found) << truth.center.transpose() << ", gain " << gain;
      EXPECT_LT((found->center - truth.center).norm(), 0.05) << gain;  // of interpolating between pixels
      // Noise of one grey level moves it by 1 / (6.3 gain 15) px, 1 sigma: the clouds' gradient is 6.3 a pixel and
      // there are 15 x 15 of them. Half as much again because warp and light are estimated too; three of those sigmas.
      const auto noisy = patch->find(clouds.picture(truth, gain, 5.0, 1.0), start);
      ASSERT_TRUE(noisy) << truth.center.transpose() << ", gain " << gain;
      EXPECT_LT((noisy->center - found->center).norm(), 0.05 / gain) << gain;
      EXPECT_LT((found->A - truth.A).cwiseAbs().maxCoeff(), 0.02) << gain;
    }
  }
}

TEST(ReferencePatch, RefusesWhatLooksDifferent) {
  const Clouds clouds;
  const auto patch = ReferencePatch::cut(clouds.picture(kStraight), kStraight.center);
  ASSERT_TRUE(patch);
  EXPECT_FALSE(patch->find(clouds.picture(warped(25.0, 10.0, 0.0, 1.0)), kStraight));  // another place
  EXPECT_FALSE(patch->find(clouds.picture(warped(0.0, 0.0, 0.0, 2.6)), kStraight));
  EXPECT_FALSE(patch->find(cv::Mat(80, 80, CV_8UC1, cv::Scalar(0)), kStraight));
}

TEST(ReferencePatch, StaysWithinThePicture) {
  const Clouds clouds;
  const cv::Mat gray = clouds.picture(kStraight);
  for (const Eigen::Vector2d& center : {Eigen::Vector2d(3.0, 40.0), Eigen::Vector2d(40.0, 76.0)}) {
    EXPECT_FALSE(ReferencePatch::cut(gray, center));
    const auto patch = ReferencePatch::cut(gray, kStraight.center);
    ASSERT_TRUE(patch);
    EXPECT_FALSE(patch->find(gray, {center, Eigen::Matrix2d::Identity()}));
  }
}

TEST(ReferencePatch, NeedsTextureInBothDirections) {
  EXPECT_FALSE(ReferencePatch::cut(cv::Mat(80, 80, CV_8UC1, cv::Scalar(90)), kStraight.center));
  cv::Mat edge(80, 80, CV_8UC1, cv::Scalar(40));
  edge.colRange(40, 80).setTo(200);
  EXPECT_FALSE(ReferencePatch::cut(edge, kStraight.center));
}

}  // namespace
}  // namespace cocalib
