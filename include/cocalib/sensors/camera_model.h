#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

namespace cocalib {

/// Central camera: pinhole with radial-tangential (plumb_bob, 4 or 5 coefficients), rational (8) or equidistant
/// (Kannala-Brandt, 4) distortion, with OpenCV's meaning and order of the coefficients.
/// Immutable; safe from any thread.
class CameraModel {
 public:
  enum class Distortion { kRadTan, kRational, kEquidistant };

  /// @param intrinsics   fu, fv, cu, cv [px]
  /// @param coefficients 0, 4 or 5 (radtan): k1 k2 p1 p2 [k3]; 8 (rational): k1 k2 p1 p2 k3 k4 k5 k6;
  ///                     4 (equidistant): k1 k2 k3 k4
  /// @throws std::invalid_argument naming what is out of range, or when the distortion folds over close to the centre
  CameraModel(Distortion distortion, const Eigen::Vector4d& intrinsics, std::vector<double> coefficients, int width,
              int height);

  /// From a model name: "pinhole-radtan" | "pinhole-equi" (rig file) or "plumb_bob" | "rational_polynomial" |
  /// "equidistant" | "fisheye" (CameraInfo). @throws std::invalid_argument for another name
  static CameraModel fromName(const std::string& name, const Eigen::Vector4d& intrinsics,
                              std::vector<double> coefficients, int width, int height);

  /// Pixel of a point in the camera frame; nothing if it is behind the camera (z <= 0, for every model) or where the
  /// distortion folds over. The pixel may lie outside the image. J (2x3): d pixel / d p_C.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_C, Eigen::Matrix<double, 2, 3>* J = nullptr) const;

  /// Unit-length bearing (z > 0) of a pixel, by iteration to 1e-10; nothing where the model has no inverse.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& px) const;

  bool inImage(const Eigen::Vector2d& px, double margin_px = 0.0) const {
    return px.x() >= margin_px && px.y() >= margin_px && px.x() <= width_ - 1.0 - margin_px &&
           px.y() <= height_ - 1.0 - margin_px;
  }
  int width() const { return width_; }
  int height() const { return height_; }
  const Eigen::Vector4d& intrinsics() const { return intrinsics_; }
  const std::vector<double>& coefficients() const { return coefficients_; }
  Distortion distortion() const { return distortion_; }
  /// Mean focal length [px], to turn angles into pixels.
  double focalPx() const { return 0.5 * (intrinsics_[0] + intrinsics_[1]); }

 private:
  double radialDerivative(double radius) const;
  double findMaxRadius() const;
  Eigen::Vector2d distort(const Eigen::Vector2d& m, Eigen::Matrix2d* J) const;
  double distortAngle(double angle, double* derivative) const;
  std::optional<double> invertRadius(double distorted) const;
  std::optional<Eigen::Vector2d> undistort(const Eigen::Vector2d& distorted) const;

  Distortion distortion_;
  Eigen::Vector4d intrinsics_;
  std::vector<double> coefficients_;
  int width_, height_;
  std::array<double, 8> k_{};  // coefficients, padded with zeros
  double max_radius_ = 0.0;    // undistorted radius (or angle) up to which the distortion grows monotonically
};

}  // namespace cocalib
