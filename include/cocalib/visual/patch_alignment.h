#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace cocalib {

/// Where a reference patch appears in another picture: x -> center + A x, x in pixels from the middle of the patch.
struct PatchPlace {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();  ///< [px]
  Eigen::Matrix2d A = Eigen::Matrix2d::Identity();
};

/// A small piece of a picture that is found again by an affine warp with gain and offset of the brightness. Followed
/// from picture to picture, a feature's errors add up; measured against one reference they do not.
/// Inverse compositional image alignment (Baker and Matthews, IJCV 2004). Immutable; safe from any thread.
class ReferencePatch {
 public:
  /// Cuts a patch of kSize x kSize around `center`; nothing where it leaves the picture (CV_8UC1) or shows no texture
  /// in some direction.
  static std::optional<ReferencePatch> cut(const cv::Mat& gray, const Eigen::Vector2d& center);

  /// Finds the patch in `gray` near `start`. @return nothing where it leaves the picture, does not converge, has
  /// changed beyond recognition or is deformed by more than a factor of two
  std::optional<PatchPlace> find(const cv::Mat& gray, const PatchPlace& start) const;

  static constexpr int kSize = 15;  ///< [px], odd

 private:
  static constexpr int kPixels = kSize * kSize;
  // Translation, A by rows, gain, offset.
  static constexpr int kParameters = 8;
  using Vector = Eigen::Matrix<float, kParameters, 1>;

  ReferencePatch() = default;
  /// Differences between the picture under the warp and the reference; false where it leaves the picture.
  bool compare(const cv::Mat& gray, const PatchPlace& place, Eigen::Matrix<float, kPixels, 1>* difference) const;

  Eigen::Matrix<float, kPixels, 1> gray_;
  Eigen::Matrix<float, kPixels, kParameters> J_;
  Eigen::Matrix<float, kParameters, kParameters> H_inverse_;
  float contrast2_ = 0.0F;  // sum of squares about the mean
};

}  // namespace cocalib
