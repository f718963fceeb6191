#include "cocalib/visual/corner_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cocalib {
namespace {

constexpr double kMinSquarePx = 5.0;    // below, neighbouring corners blur into each other
constexpr double kReachSquares = 0.42;  // the next edge stands at 1; beyond half its blur would come in
constexpr double kMinReachPx = 3.0, kMaxReachPx = 9.0;
constexpr double kSampleSquares = 0.3;  // where the four fields around a corner are sampled
constexpr double kMinBlurPx = 0.28;     // a sharp edge averaged over a pixel: sqrt(1/12)
constexpr double kMaxBlurPx = 4.0;
constexpr double kMaxBlurChange = 1.5;  // per iteration; a blur far too small sees no edge at all
constexpr double kMaxStepPx = 1.0;
constexpr double kBandSigmas = 3.0;  // beyond, an edge's profile is flat and tells nothing of its place ...
constexpr double kMinBandPx = 1.5;   // ... but some flat pixels must tell the two grey levels

/// Blurred unit step and its slope, tabulated: erf(z / sqrt 2) and its derivative.
class EdgeProfile {
 public:
  struct Value {
    double step, slope;
  };
  EdgeProfile() {
    for (int i = 0; i < kSize; ++i) {
      const double z = (i - kSize / 2) * kStep;
      table_[i] = {std::erf(z / std::sqrt(2.0)), std::sqrt(2.0 / M_PI) * std::exp(-0.5 * z * z)};
    }
  }
  Value at(double z) const {
    const double position = z / kStep + kSize / 2;
    if (position <= 0.0) return {-1.0, 0.0};
    if (position >= kSize - 1) return {1.0, 0.0};
    const int i = static_cast<int>(position);
    const double f = position - i;
    const Value &a = table_[i], &b = table_[i + 1];
    return {a.step + f * (b.step - a.step), a.slope + f * (b.slope - a.slope)};
  }

 private:
  static constexpr int kSize = 513;
  static constexpr double kStep = 1.0 / 60.0;  // +-4.27 sigma
  std::array<Value, kSize> table_;
};

double sampleBilinear(const cv::Mat& gray, double x, double y, bool* inside) {
  const int ix = static_cast<int>(std::floor(x)), iy = static_cast<int>(std::floor(y));
  if (ix < 0 || iy < 0 || ix + 1 >= gray.cols || iy + 1 >= gray.rows) {
    *inside = false;
    return 0.0;
  }
  const double fx = x - ix, fy = y - iy;
  const std::uint8_t *top = gray.ptr<std::uint8_t>(iy) + ix, *bottom = gray.ptr<std::uint8_t>(iy + 1) + ix;
  return (1.0 - fy) * ((1.0 - fx) * top[0] + fx * top[1]) + fy * ((1.0 - fx) * bottom[0] + fx * bottom[1]);
}

/// Mean of the four fields' samples and (light - dark) / 2, as predicted.
struct FieldLevels {
  double mean = 0.0, contrast = 0.0;
  bool inside = true;
};
FieldLevels sampleFields(const cv::Mat& gray, const CornerPrediction& corner, const Eigen::Vector2d& center) {
  const Eigen::Vector2d diagonal = kSampleSquares * (corner.x_edge + corner.y_edge);
  const Eigen::Vector2d other = kSampleSquares * (corner.x_edge - corner.y_edge);
  FieldLevels levels;
  const double same = sampleBilinear(gray, center.x() + diagonal.x(), center.y() + diagonal.y(), &levels.inside) +
                      sampleBilinear(gray, center.x() - diagonal.x(), center.y() - diagonal.y(), &levels.inside);
  const double opposite = sampleBilinear(gray, center.x() + other.x(), center.y() + other.y(), &levels.inside) +
                          sampleBilinear(gray, center.x() - other.x(), center.y() - other.y(), &levels.inside);
  levels.mean = 0.25 * (same + opposite);
  levels.contrast = (corner.light_diagonal ? 0.25 : -0.25) * (same - opposite);
  return levels;
}

/// The model around one corner, its parameters and one Gauss-Newton step.
class CornerFit {
 public:
  // Corner x, y; grey level; signed contrast; slope of the light x, y; blur of the x line and of the y line.
  enum { kX, kY, kLevel, kContrast, kSlopeX, kSlopeY, kBlurX, kBlurY, kParameters };
  using Vector = Eigen::Matrix<double, kParameters, 1>;
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;

  CornerFit(const cv::Mat& gray, const CornerPrediction& corner) : gray_(gray) {
    Eigen::Matrix2d edges;
    edges << corner.x_edge, corner.y_edge;
    to_squares_ = edges.inverse();
    const double x_length = corner.x_edge.norm(), y_length = corner.y_edge.norm();
    x_normal_ = Eigen::Vector2d(-corner.x_edge.y(), corner.x_edge.x()) / x_length;
    if (x_normal_.dot(corner.y_edge) < 0.0) x_normal_ = -x_normal_;
    y_normal_ = Eigen::Vector2d(-corner.y_edge.y(), corner.y_edge.x()) / y_length;
    if (y_normal_.dot(corner.x_edge) < 0.0) y_normal_ = -y_normal_;
    x_bend_ = 0.5 * x_normal_.dot(corner.x_bend);
    y_bend_ = 0.5 * y_normal_.dot(corner.y_bend);
    reach_x_ = std::clamp(kReachSquares * x_length, kMinReachPx, kMaxReachPx) / x_length;
    reach_y_ = std::clamp(kReachSquares * y_length, kMinReachPx, kMaxReachPx) / y_length;
    half_width_ = reach_x_ * std::abs(corner.x_edge.x()) + reach_y_ * std::abs(corner.y_edge.x());
    half_height_ = reach_x_ * std::abs(corner.x_edge.y()) + reach_y_ * std::abs(corner.y_edge.y());
  }

  /// Adds up the normal equations at `p`; false where the window leaves the picture.
  bool linearize(const Vector& p, bool free_blur) {
    return free_blur ? linearizeFirst<kParameters>(p) : linearizeFirst<kBlurX>(p);
  }
  /// Solves them. @param free_blur as in linearize()
  Vector solve(bool free_blur) const {
    const int n = free_blur ? kParameters : kBlurX;
    Matrix H = H_.selfadjointView<Eigen::Upper>();
    H.diagonal() *= 1.0 + 1e-6;
    H.diagonal().array() += 1e-6;
    Vector step = Vector::Zero();
    step.head(n) = H.topLeftCorner(n, n).ldlt().solve(g_.head(n));
    return step;
  }
  double residualRms() const { return weight_ > 0.0 ? std::sqrt(cost_ / weight_) : 0.0; }

 private:
  /// @tparam kFree  so many of the parameters, known when this is compiled: it is called for every pixel
  template <int kFree>
  bool linearizeFirst(const Vector& p);
  static double taper(double distance, double reach) {
    const double t = std::abs(distance) / reach;
    if (t <= 0.7) return 1.0;
    const double s = (1.0 - t) / 0.3;
    return s * s * (3.0 - 2.0 * s);
  }

  const cv::Mat& gray_;
  Eigen::Matrix2d to_squares_;
  Eigen::Vector2d x_normal_, y_normal_;
  double x_bend_, y_bend_, reach_x_, reach_y_, half_width_, half_height_;
  Matrix H_;
  Vector g_;
  double cost_ = 0.0, weight_ = 0.0;
};

template <int kFree>
bool CornerFit::linearizeFirst(const Vector& p) {
  static const EdgeProfile profile;
  const int x0 = static_cast<int>(std::ceil(p[kX] - half_width_)), x1 = static_cast<int>(p[kX] + half_width_);
  const int y0 = static_cast<int>(std::ceil(p[kY] - half_height_)), y1 = static_cast<int>(p[kY] + half_height_);
  if (x0 < 0 || y0 < 0 || x1 >= gray_.cols || y1 >= gray_.rows) return false;
  H_.setZero();
  g_.setZero();
  cost_ = weight_ = 0.0;
  const double inv_blur_x = 1.0 / p[kBlurX], inv_blur_y = 1.0 / p[kBlurY];
  const double band_x = std::max(kBandSigmas, kMinBandPx * inv_blur_x);
  const double band_y = std::max(kBandSigmas, kMinBandPx * inv_blur_y);
  double J[kParameters];
  for (int y = y0; y <= y1; ++y) {
    const std::uint8_t* row = gray_.ptr<std::uint8_t>(y);
    const double dy = y - p[kY];
    for (int x = x0; x <= x1; ++x) {
      const double dx = x - p[kX];
      const double a = to_squares_(0, 0) * dx + to_squares_(0, 1) * dy;
      const double b = to_squares_(1, 0) * dx + to_squares_(1, 1) * dy;
      if (std::abs(a) >= reach_x_ || std::abs(b) >= reach_y_) continue;
      // Distance to the x line (blurred by blur_x) and to the y line, in standard deviations of their blur.
      const double u = (x_normal_.x() * dx + x_normal_.y() * dy - x_bend_ * a * a) * inv_blur_x;
      const double v = (y_normal_.x() * dx + y_normal_.y() * dy - y_bend_ * b * b) * inv_blur_y;
      if (std::abs(u) > band_x && std::abs(v) > band_y) continue;
      const EdgeProfile::Value across_x = profile.at(u), across_y = profile.at(v);
      const double pattern = across_x.step * across_y.step;
      const double to_u = p[kContrast] * across_x.slope * across_y.step * inv_blur_x;
      const double to_v = p[kContrast] * across_x.step * across_y.slope * inv_blur_y;
      J[kX] = -(to_u * x_normal_.x() + to_v * y_normal_.x());
      J[kY] = -(to_u * x_normal_.y() + to_v * y_normal_.y());
      J[kLevel] = 1.0;
      J[kContrast] = pattern;
      J[kSlopeX] = dx;
      J[kSlopeY] = dy;
      J[kBlurX] = -u * to_u;
      J[kBlurY] = -v * to_v;
      const double r = row[x] - (p[kLevel] + p[kContrast] * pattern + p[kSlopeX] * dx + p[kSlopeY] * dy);
      const double weight = taper(a, reach_x_) * taper(b, reach_y_);
      cost_ += weight * r * r;
      weight_ += weight;
      for (int i = 0; i < kFree; ++i) {
        const double wJ = weight * J[i];
        g_[i] += wJ * r;
        for (int j = i; j < kFree; ++j) H_(i, j) += wJ * J[j];
      }
    }
  }
  return weight_ > 2.0 * kParameters;
}

}  // namespace

std::optional<std::vector<CornerPrediction>> predictCorners(const Pose& T_C_B, const BoardGeometry& board,
                                                            const CameraModel& camera, bool first_square_light) {
  const Eigen::Matrix3d R = T_C_B.R();
  if (R.col(2).dot(T_C_B.t) <= 0.0) return std::nullopt;  // the back of the board
  const Eigen::Vector3d half_x = 0.5 * board.square_m * R.col(0), half_y = 0.5 * board.square_m * R.col(1);
  std::vector<CornerPrediction> predictions(board.cornerCount());
  for (int i = 0; i < board.cornerCount(); ++i) {
    const Eigen::Vector3d p_C = T_C_B * board.corner(i);
    const auto center = camera.project(p_C);
    const auto right = camera.project(p_C + half_x), left = camera.project(p_C - half_x);
    const auto below = camera.project(p_C + half_y), above = camera.project(p_C - half_y);
    if (!center || !right || !left || !below || !above) return std::nullopt;
    CornerPrediction& prediction = predictions[i];
    prediction.px = *center;
    prediction.x_edge = *right - *left;
    prediction.y_edge = *below - *above;
    prediction.x_bend = 4.0 * (*right + *left - 2.0 * *center);
    prediction.y_bend = 4.0 * (*below + *above - 2.0 * *center);
    prediction.light_diagonal = ((i / board.cols + i % board.cols) % 2 == 0) == first_square_light;
    if (prediction.x_edge.norm() < kMinSquarePx || prediction.y_edge.norm() < kMinSquarePx) return std::nullopt;
    // Seen nearly edge-on the two lines fall together.
    const double area = prediction.x_edge.x() * prediction.y_edge.y() - prediction.x_edge.y() * prediction.y_edge.x();
    if (area < 0.2 * prediction.x_edge.norm() * prediction.y_edge.norm()) return std::nullopt;
  }
  return predictions;
}

double cornerContrast(const cv::Mat& gray, const CornerPrediction& prediction) {
  const FieldLevels levels = sampleFields(gray, prediction, prediction.px);
  return levels.inside ? levels.contrast : 0.0;
}

Eigen::Vector2d findBoardShift(const cv::Mat& gray, const std::vector<CornerPrediction>& predictions,
                               double max_shift_px) {
  // Nearest pixels are good enough to find the peak by; the fit of each corner does the rest.
  std::vector<cv::Point> light, dark;
  double square_px = 1e9;
  for (const CornerPrediction& prediction : predictions) {
    square_px = std::min({square_px, prediction.x_edge.norm(), prediction.y_edge.norm()});
    for (const double sign : {-kSampleSquares, kSampleSquares}) {
      const Eigen::Vector2d same = prediction.px + sign * (prediction.x_edge + prediction.y_edge);
      const Eigen::Vector2d other = prediction.px + sign * (prediction.x_edge - prediction.y_edge);
      (prediction.light_diagonal ? light : dark).emplace_back(std::lround(same.x()), std::lround(same.y()));
      (prediction.light_diagonal ? dark : light).emplace_back(std::lround(other.x()), std::lround(other.y()));
    }
  }
  const cv::Rect inside(0, 0, gray.cols, gray.rows);
  const cv::Rect light_box = cv::boundingRect(light), dark_box = cv::boundingRect(dark);
  const int stride = static_cast<int>(gray.step);
  const auto score = [&](const cv::Point& shift) {
    int sum = 0;
    const cv::Rect box = (light_box | dark_box) + shift;
    const bool all_inside = (box & inside) == box;
    const std::uint8_t* origin = gray.data + shift.y * stride + shift.x;
    for (std::size_t i = 0; i < light.size(); ++i) {
      if (!all_inside && !(inside.contains(light[i] + shift) && inside.contains(dark[i] + shift))) continue;
      sum += origin[light[i].y * stride + light[i].x] - origin[dark[i].y * stride + dark[i].x];
    }
    return sum;
  };
  cv::Point best(0, 0);
  int best_score = score(best);
  // The score falls off over about a third of a square: no coarser step may jump over its peak.
  int step = std::max(1, static_cast<int>(0.2 * square_px));
  int count = static_cast<int>(std::ceil(max_shift_px / step));
  for (; step > 0; step /= 2, count = 1) {
    const cv::Point center = best;
    for (int iy = -count; iy <= count; ++iy) {
      for (int ix = -count; ix <= count; ++ix) {
        const cv::Point shift = center + cv::Point(ix * step, iy * step);
        const int value = score(shift);
        if (value <= best_score) continue;
        best_score = value;
        best = shift;
      }
    }
  }
  return {best.x, best.y};
}

std::optional<RefinedCorner> refineCorner(const cv::Mat& gray, const CornerPrediction& prediction, double start_blur_px,
                                          bool free_blur, int iterations, double tolerance_px) {
  const FieldLevels levels = sampleFields(gray, prediction, prediction.px);
  if (!levels.inside) return std::nullopt;
  const double sign = prediction.light_diagonal ? 1.0 : -1.0;
  const double max_shift = 0.5 * std::min(prediction.x_edge.norm(), prediction.y_edge.norm());
  CornerFit fit(gray, prediction);
  CornerFit::Vector p = CornerFit::Vector::Zero();
  // A start on the wrong side of the corner may sample no contrast at all; any small one of the right sign will do.
  p << prediction.px, levels.mean, sign * std::max(levels.contrast, 5.0), 0.0, 0.0, start_blur_px, start_blur_px;
  for (int i = 0; i < iterations; ++i) {
    if (!fit.linearize(p, free_blur)) return std::nullopt;
    CornerFit::Vector step = fit.solve(free_blur);
    if (!step.allFinite()) return std::nullopt;
    const double length = step.head<2>().norm();
    if (length > kMaxStepPx) step.head<2>() *= kMaxStepPx / length;
    const Eigen::Vector2d blur = p.tail<2>();
    p += step;
    for (int k = 0; k < 2; ++k) {
      const double change = std::clamp(p[CornerFit::kBlurX + k] / blur[k], 1.0 / kMaxBlurChange, kMaxBlurChange);
      p[CornerFit::kBlurX + k] = std::clamp(change * blur[k], kMinBlurPx, kMaxBlurPx);
    }
    if ((p.head<2>() - prediction.px).norm() > max_shift || sign * p[CornerFit::kContrast] <= 0.0) return std::nullopt;
    if (length < tolerance_px) break;
  }
  return RefinedCorner{p.head<2>(), sign * p[CornerFit::kContrast], 0.5 * (p[CornerFit::kBlurX] + p[CornerFit::kBlurY]),
                       fit.residualRms()};
}

}  // namespace cocalib
