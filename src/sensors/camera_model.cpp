#include "cocalib/sensors/camera_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace cocalib {
namespace {

constexpr double kLargestTangent = 1e3;             // tan of 89.94 deg: no picture reaches further out
constexpr double kLargestAngle = 0.5 * 3.14159265;  // equidistant: only what lies in front of the camera [rad]
constexpr int kLargestSide = 65536;                 // [px]
constexpr double kTolerance = 1e-12;                // of the inverse, on the normalised plane or in rad
constexpr int kMaxIterations = 100;                 // bisection alone would need 50

bool allFinite(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

void checkCoefficientCount(CameraModel::Distortion distortion, std::size_t count) {
  switch (distortion) {
    case CameraModel::Distortion::kRadTan:
      if (count == 0 || count == 4 || count == 5) return;
      throw std::invalid_argument("radial-tangential distortion needs 0, 4 or 5 coefficients, got " +
                                  std::to_string(count));
    case CameraModel::Distortion::kRational:
      if (count == 8) return;
      throw std::invalid_argument("rational distortion needs 8 coefficients, got " + std::to_string(count));
    case CameraModel::Distortion::kEquidistant:
      if (count == 4) return;
      throw std::invalid_argument("equidistant distortion needs 4 coefficients, got " + std::to_string(count));
  }
}

}  // namespace

CameraModel::CameraModel(Distortion distortion, const Eigen::Vector4d& intrinsics, std::vector<double> coefficients,
                         int width, int height)
    : distortion_(distortion),
      intrinsics_(intrinsics),
      coefficients_(std::move(coefficients)),
      width_(width),
      height_(height) {
  if (!intrinsics_.allFinite()) throw std::invalid_argument("intrinsics must be finite");
  if (intrinsics_[0] <= 0.0 || intrinsics_[1] <= 0.0) {
    throw std::invalid_argument("focal lengths must be > 0 px, got " + std::to_string(intrinsics_[0]) + ", " +
                                std::to_string(intrinsics_[1]));
  }
  if (width_ <= 0 || height_ <= 0 || width_ > kLargestSide || height_ > kLargestSide) {
    throw std::invalid_argument("image size must be in [1, 65536] px, got " + std::to_string(width_) + " x " +
                                std::to_string(height_));
  }
  checkCoefficientCount(distortion_, coefficients_.size());
  if (!allFinite(coefficients_)) throw std::invalid_argument("distortion coefficients must be finite");
  std::copy(coefficients_.begin(), coefficients_.end(), k_.begin());

  max_radius_ = findMaxRadius();
  // A model that folds over within the inner quarter of the picture belongs to another camera.
  const double folded_px =
      focalPx() * (distortion_ == Distortion::kEquidistant ? distortAngle(max_radius_, nullptr)
                                                           : distort({max_radius_, 0.0}, nullptr).norm());
  if (!std::isfinite(folded_px)) throw std::invalid_argument("the distortion is too large for a lens");
  if (folded_px < 0.25 * 0.5 * std::min(width_, height_)) {
    throw std::invalid_argument("the distortion folds over " + std::to_string(folded_px) +
                                " px from the centre; check model and order of the coefficients");
  }
}

CameraModel CameraModel::fromName(const std::string& name, const Eigen::Vector4d& intrinsics,
                                  std::vector<double> coefficients, int width, int height) {
  Distortion distortion = Distortion::kRadTan;
  if (name == "pinhole-equi" || name == "equidistant" || name == "fisheye") {
    distortion = Distortion::kEquidistant;
  } else if (name == "rational_polynomial" || (name == "pinhole-radtan" && coefficients.size() == 8)) {
    distortion = Distortion::kRational;
  } else if (name != "pinhole-radtan" && name != "plumb_bob") {
    throw std::invalid_argument("unknown camera model '" + name +
                                "'; known: pinhole-radtan, pinhole-equi, plumb_bob, rational_polynomial, "
                                "equidistant, fisheye");
  }
  return CameraModel(distortion, intrinsics, std::move(coefficients), width, height);
}

/// d distorted / d undistorted along the radius (or angle), in the least favourable direction: decentring adds
/// 3 r^2 (p1 sin + p2 cos) to the distorted radius.
double CameraModel::radialDerivative(double radius) const {
  const double r2 = radius * radius;
  if (distortion_ == Distortion::kEquidistant) {
    return 1.0 + r2 * (3.0 * k_[0] + r2 * (5.0 * k_[1] + r2 * (7.0 * k_[2] + r2 * 9.0 * k_[3])));
  }
  const double numerator = 1.0 + r2 * (k_[0] + r2 * (k_[1] + r2 * k_[4]));
  const double denominator = 1.0 + r2 * (k_[5] + r2 * (k_[6] + r2 * k_[7]));
  if (denominator <= 0.0) return -1.0;  // past a pole
  const double d_numerator = k_[0] + r2 * (2.0 * k_[1] + r2 * 3.0 * k_[4]);
  const double d_denominator = k_[5] + r2 * (2.0 * k_[6] + r2 * 3.0 * k_[7]);
  const double d_ratio = (d_numerator * denominator - numerator * d_denominator) / (denominator * denominator);
  return numerator / denominator + 2.0 * r2 * d_ratio - 6.0 * radius * std::hypot(k_[2], k_[3]);
}

double CameraModel::findMaxRadius() const {
  const double limit = distortion_ == Distortion::kEquidistant ? kLargestAngle : kLargestTangent;
  double good = 0.0;
  double bad = limit;
  // Steps of a thousandth: a fold narrower than that is no lens.
  for (double radius = 1e-3; radius < limit; radius += 1e-3 * (1.0 + radius)) {
    if (radialDerivative(radius) <= 0.0) {
      bad = radius;
      break;
    }
    good = radius;
  }
  if (bad == limit && radialDerivative(limit) > 0.0) return limit;
  while (bad - good > kTolerance) {
    const double middle = 0.5 * (good + bad);
    (radialDerivative(middle) > 0.0 ? good : bad) = middle;
  }
  return good;
}

Eigen::Vector2d CameraModel::distort(const Eigen::Vector2d& m, Eigen::Matrix2d* J) const {
  const double x = m.x();
  const double y = m.y();
  const double r2 = x * x + y * y;
  const double p1 = k_[2];
  const double p2 = k_[3];
  double radial = 1.0 + r2 * (k_[0] + r2 * (k_[1] + r2 * k_[4]));
  double d_radial = k_[0] + r2 * (2.0 * k_[1] + r2 * 3.0 * k_[4]);  // over r^2
  if (distortion_ == Distortion::kRational) {
    const double inverse = 1.0 / (1.0 + r2 * (k_[5] + r2 * (k_[6] + r2 * k_[7])));
    const double d_denominator = k_[5] + r2 * (2.0 * k_[6] + r2 * 3.0 * k_[7]);
    radial *= inverse;
    d_radial = (d_radial - radial * d_denominator) * inverse;
  }
  if (J != nullptr) {
    const double cross = 2.0 * x * y * d_radial + 2.0 * (p1 * x + p2 * y);
    *J << radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x, cross,  //
        cross, radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x;
  }
  return {x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
          y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y};
}

double CameraModel::distortAngle(double angle, double* derivative) const {
  const double a2 = angle * angle;
  if (derivative != nullptr) {
    *derivative = 1.0 + a2 * (3.0 * k_[0] + a2 * (5.0 * k_[1] + a2 * (7.0 * k_[2] + a2 * 9.0 * k_[3])));
  }
  return angle * (1.0 + a2 * (k_[0] + a2 * (k_[1] + a2 * (k_[2] + a2 * k_[3]))));
}

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& p_C, Eigen::Matrix<double, 2, 3>* J) const {
  const double z = p_C.z();
  if (!(z > 0.0)) return std::nullopt;
  const double fu = intrinsics_[0];
  const double fv = intrinsics_[1];

  if (distortion_ != Distortion::kEquidistant) {
    const double inv_z = 1.0 / z;
    const Eigen::Vector2d m(p_C.x() * inv_z, p_C.y() * inv_z);
    if (!(m.squaredNorm() < max_radius_ * max_radius_)) return std::nullopt;
    Eigen::Matrix2d J_m;
    const Eigen::Vector2d d = distort(m, J != nullptr ? &J_m : nullptr);
    if (J != nullptr) {
      J_m.row(0) *= fu * inv_z;
      J_m.row(1) *= fv * inv_z;
      J->leftCols<2>() = J_m;
      J->col(2) = -(J_m * m);
    }
    return Eigen::Vector2d(fu * d.x() + intrinsics_[2], fv * d.y() + intrinsics_[3]);
  }

  const double rho2 = p_C.head<2>().squaredNorm();
  const double rho = std::sqrt(rho2);
  const double angle = std::atan2(rho, z);
  if (!(angle < max_radius_)) return std::nullopt;
  double d_angle = 1.0;
  const double distorted = distortAngle(angle, &d_angle);
  const bool on_axis = rho < 1e-9 * z;  // there the model is the pinhole's, to rounding
  const double scale = on_axis ? 1.0 / z : distorted / rho;
  if (J != nullptr) {
    const double inv_range2 = 1.0 / (rho2 + z * z);
    // d scale / d rho, divided by rho: scale depends on x and y through rho only, and d rho / d x = x / rho.
    const double d_scale = on_axis ? 0.0 : (d_angle * z * inv_range2 - scale) / rho2;
    const double d_scale_z = on_axis ? -1.0 / (z * z) : -d_angle * inv_range2;
    const double x = p_C.x();
    const double y = p_C.y();
    *J << fu * (scale + x * x * d_scale), fu * x * y * d_scale, fu * x * d_scale_z,  //
        fv * x * y * d_scale, fv * (scale + y * y * d_scale), fv * y * d_scale_z;
  }
  return Eigen::Vector2d(fu * p_C.x() * scale + intrinsics_[2], fv * p_C.y() * scale + intrinsics_[3]);
}

/// Radius (or angle) whose distorted value, decentring apart, is `distorted`: Newton's method kept inside a bracket.
std::optional<double> CameraModel::invertRadius(double distorted) const {
  const auto evaluate = [this](double radius, double* derivative) {
    if (distortion_ == Distortion::kEquidistant) return distortAngle(radius, derivative);
    const double r2 = radius * radius;
    const double numerator = 1.0 + r2 * (k_[0] + r2 * (k_[1] + r2 * k_[4]));
    const double denominator = 1.0 + r2 * (k_[5] + r2 * (k_[6] + r2 * k_[7]));
    *derivative = radialDerivative(radius);
    return radius * numerator / denominator;
  };
  double low = 0.0;
  double high = max_radius_;
  double derivative = 1.0;
  if (evaluate(high, &derivative) < distorted) return std::nullopt;
  double radius = std::min(distorted, 0.5 * high);
  for (int i = 0; i < kMaxIterations && high - low > kTolerance; ++i) {
    const double error = evaluate(radius, &derivative) - distorted;
    (error > 0.0 ? high : low) = radius;
    const double next = radius - error / derivative;
    const bool inside = std::isfinite(next) && next > low && next < high;
    const double step = (inside ? next : 0.5 * (low + high)) - radius;
    radius += step;
    if (inside && std::abs(step) <= kTolerance * (1.0 + radius)) break;
  }
  return radius;
}

std::optional<Eigen::Vector2d> CameraModel::undistort(const Eigen::Vector2d& distorted) const {
  const double norm = distorted.norm();
  // The radial part alone starts Newton's method close enough; decentring is small. Past the fold, start at it.
  const double radius = invertRadius(norm).value_or(max_radius_);
  Eigen::Vector2d m = norm > 0.0 ? Eigen::Vector2d(distorted * (radius / norm)) : distorted;
  Eigen::Matrix2d J;
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector2d error = distort(m, &J) - distorted;
    const double determinant = J.determinant();
    if (!(determinant > 0.0)) return std::nullopt;
    const Eigen::Vector2d step((J(1, 1) * error.x() - J(0, 1) * error.y()) / determinant,
                               (J(0, 0) * error.y() - J(1, 0) * error.x()) / determinant);
    m -= step;
    if (!(m.squaredNorm() < max_radius_ * max_radius_)) return std::nullopt;
    if (step.norm() <= kTolerance * (1.0 + m.norm())) return m;
  }
  return std::nullopt;
}

std::optional<Eigen::Vector3d> CameraModel::unproject(const Eigen::Vector2d& px) const {
  if (!px.allFinite()) return std::nullopt;
  const Eigen::Vector2d distorted((px.x() - intrinsics_[2]) / intrinsics_[0],
                                  (px.y() - intrinsics_[3]) / intrinsics_[1]);
  if (distortion_ != Distortion::kEquidistant) {
    const std::optional<Eigen::Vector2d> m = undistort(distorted);
    if (!m) return std::nullopt;
    return m->homogeneous().normalized();
  }
  const double norm = distorted.norm();
  if (norm < 1e-12) return Eigen::Vector3d(distorted.x(), distorted.y(), 1.0).normalized();
  const std::optional<double> angle = invertRadius(norm);
  if (!angle || !(*angle < max_radius_)) return std::nullopt;
  const double sine = std::sin(*angle) / norm;
  return Eigen::Vector3d(distorted.x() * sine, distorted.y() * sine, std::cos(*angle));
}

}  // namespace cocalib
