#include "cocalib/visual/patch_alignment.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace cocalib {
namespace {

constexpr int kHalf = ReferencePatch::kSize / 2;
constexpr int kMaxIterations = 12;
constexpr double kEnough_px = 0.005;          // of the centre, in one step
constexpr double kFarthest_px = 3.0;          // from the start
constexpr float kMaxChange = 0.15F;           // squares left over, of the patch's contrast
constexpr double kMaxStretch = 1.6;           // of A, either way
constexpr float kMinGradient2 = 2.0F * 2.0F;  // (grey levels / px)^2, mean over the patch, in the weaker direction
// Deformation that a patch does not show stays as it is: as if known to 0.1 beside noise of three grey levels.
constexpr float kDeformationPrior = 900.0F;

bool inside(const cv::Mat& gray, const Eigen::Vector2d& center, double reach) {
  return center.x() >= reach && center.y() >= reach && center.x() < gray.cols - 1 - reach &&
         center.y() < gray.rows - 1 - reach;
}

float sample(const std::uint8_t* pixels, std::size_t row_step, float x, float y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  const std::uint8_t* p = pixels + static_cast<std::size_t>(iy) * row_step + ix;
  const std::uint8_t* q = p + row_step;
  const float top = p[0] + fx * static_cast<float>(p[1] - p[0]);
  const float bottom = q[0] + fx * static_cast<float>(q[1] - q[0]);
  return top + fy * (bottom - top);
}

float sample(const cv::Mat& gray, float x, float y) { return sample(gray.data, gray.step, x, y); }

bool isPlausible(const Eigen::Matrix2d& A) {
  const Eigen::Vector2d stretch = A.jacobiSvd().singularValues();
  return A.determinant() > 0.0 && stretch[0] <= kMaxStretch && stretch[1] >= 1.0 / kMaxStretch;
}

}  // namespace

std::optional<ReferencePatch> ReferencePatch::cut(const cv::Mat& gray, const Eigen::Vector2d& center) {
  if (!inside(gray, center, kHalf + 2.0)) return std::nullopt;
  ReferencePatch patch;
  Eigen::Matrix2f structure = Eigen::Matrix2f::Zero();
  for (int i = 0; i < kPixels; ++i) {
    const auto dx = static_cast<float>(i % kSize - kHalf), dy = static_cast<float>(i / kSize - kHalf);
    const float x = static_cast<float>(center.x()) + dx, y = static_cast<float>(center.y()) + dy;
    const float gx = 0.5F * (sample(gray, x + 1.0F, y) - sample(gray, x - 1.0F, y));
    const float gy = 0.5F * (sample(gray, x, y + 1.0F) - sample(gray, x, y - 1.0F));
    patch.gray_[i] = sample(gray, x, y);
    patch.J_.row(i) << gx, gy, gx * dx, gx * dy, gy * dx, gy * dy, patch.gray_[i], 1.0F;
    structure += Eigen::Vector2f(gx, gy) * Eigen::RowVector2f(gx, gy);
  }
  const float mean_gradient2 = 0.5F * structure.trace();
  const float spread = std::hypot(0.5F * (structure(0, 0) - structure(1, 1)), structure(0, 1));
  if (mean_gradient2 - spread < kMinGradient2 * kPixels) return std::nullopt;
  patch.contrast2_ = (patch.gray_.array() - patch.gray_.mean()).square().sum();
  Eigen::Matrix<float, kParameters, kParameters> H = patch.J_.transpose() * patch.J_;
  H.diagonal().segment<4>(2).array() += kDeformationPrior;
  // Double precision: a bright patch's gain and offset are nearly the same thing.
  patch.H_inverse_ =
      H.cast<double>().ldlt().solve(Eigen::Matrix<double, kParameters, kParameters>::Identity()).cast<float>();
  if (!patch.H_inverse_.allFinite()) return std::nullopt;
  return patch;
}

bool ReferencePatch::compare(const cv::Mat& gray, const PatchPlace& place,
                             Eigen::Matrix<float, kPixels, 1>* difference) const {
  if (!inside(gray, place.center, kHalf * place.A.cwiseAbs().rowwise().sum().maxCoeff())) return false;
  const Eigen::Matrix2f A = place.A.cast<float>();
  const Eigen::Vector2f center = place.center.cast<float>();
  const std::uint8_t* pixels = gray.data;
  const std::size_t row_step = gray.step;
  for (int row = 0; row < kSize; ++row) {
    const auto dy = static_cast<float>(row - kHalf);
    const float row_x = center.x() + A(0, 1) * dy, row_y = center.y() + A(1, 1) * dy;
    for (int column = 0; column < kSize; ++column) {
      const auto dx = static_cast<float>(column - kHalf);
      const int i = row * kSize + column;
      (*difference)[i] = sample(pixels, row_step, row_x + A(0, 0) * dx, row_y + A(1, 0) * dx) - gray_[i];
    }
  }
  return true;
}

std::optional<PatchPlace> ReferencePatch::find(const cv::Mat& gray, const PatchPlace& start) const {
  PatchPlace place = start;
  Eigen::Matrix<float, kPixels, 1> difference;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!compare(gray, place, &difference)) return std::nullopt;
    const Vector rhs = J_.transpose() * difference;
    const Vector delta = H_inverse_ * rhs;
    const float gain = 1.0F + delta[6];
    if (!(gain > 0.1F && gain < 10.0F)) return std::nullopt;
    // The reference moved by W(delta) looks like the picture: the picture's warp takes the inverse.
    const Eigen::Vector2d shift = (delta.head<2>() / gain).cast<double>();
    Eigen::Matrix2d D;
    D << delta[2], delta[3], delta[4], delta[5];
    const Eigen::Matrix2d inverse = (Eigen::Matrix2d::Identity() + D / gain).inverse();
    const Eigen::Vector2d step = -place.A * inverse * shift;
    place.A = place.A * inverse;
    place.center += step;
    if (!place.center.allFinite() || (place.center - start.center).norm() > kFarthest_px) return std::nullopt;
    if (!isPlausible(place.A)) return std::nullopt;
    if (step.norm() > kEnough_px) continue;
    // What gain, offset and warp explain goes; the rest must be small beside the patch as bright as it is now.
    const float left = difference.squaredNorm() - rhs.dot(delta);
    if (left > kMaxChange * gain * gain * contrast2_) return std::nullopt;
    return place;
  }
  return std::nullopt;
}

}  // namespace cocalib
