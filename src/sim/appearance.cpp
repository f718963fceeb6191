#include "cocalib/sim/appearance.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

constexpr double kBlack = 28.0, kWhite = 218.0;  // grey values of the board; clear of saturation

// Shapes per square metre by size, the large ones first: the small ones lie on top.
struct Layer {
  double per_m2, smallest_m, largest_m;
};
constexpr Layer kLayers[] = {{6.0, 0.3, 0.9}, {25.0, 0.10, 0.3}, {60.0, 0.04, 0.10}};

// One convex polygon of 3 to 5 sides with a random grey value.
void paintShape(cv::Mat& picture, const Layer& layer, double texel_m, Random& random) {
  constexpr int kShift = 4;  // vertices in 1/16 texel
  const double x = random.uniform(0.0, picture.cols), y = random.uniform(0.0, picture.rows);
  const double radius = 0.5 * random.uniform(layer.smallest_m, layer.largest_m) / texel_m;
  const double turn = random.uniform(0.0, 6.2831853), flatness = random.uniform(0.5, 1.0);
  const int sides = 3 + static_cast<int>(random.bits() % 3U);
  const double gray = random.uniform(25.0, 225.0);
  std::vector<cv::Point> polygon;
  for (int i = 0; i < sides; ++i) {
    const double angle = 6.2831853 * i / sides;
    const double px = radius * std::cos(angle), py = flatness * radius * std::sin(angle);
    polygon.emplace_back(static_cast<int>(std::lround(16.0 * (x + px * std::cos(turn) - py * std::sin(turn)))),
                         static_cast<int>(std::lround(16.0 * (y + px * std::sin(turn) + py * std::cos(turn)))));
  }
  cv::fillConvexPoly(picture, polygon, cv::Scalar(gray), cv::LINE_AA, kShift);
}

cv::Mat paint(double width_m, double height_m, double texel_m, int index) {
  Random random(0, Random::Stream::kTexture, static_cast<std::uint64_t>(index));
  const int cols = std::max(8, static_cast<int>(std::lround(width_m / texel_m)));
  const int rows = std::max(8, static_cast<int>(std::lround(height_m / texel_m)));
  cv::Mat picture(rows, cols, CV_8UC1, cv::Scalar(random.uniform(90.0, 170.0)));
  for (const Layer& layer : kLayers) {
    const int count = static_cast<int>(std::lround(layer.per_m2 * width_m * height_m));
    for (int i = 0; i < count; ++i) paintShape(picture, layer, texel_m, random);
  }
  // Nothing finer than a texel may remain, or the interpolation would show the texel grid.
  cv::GaussianBlur(picture, picture, cv::Size(5, 5), 0.8);
  return picture;
}

// Integrals from the left border of the pattern (-1) to x of the window [-1, count] and of the window times the sign of
// the square (+1 from -1 to 0, -1 from 0 to 1, ...).
double windowIntegral(double x, int count) { return std::clamp(x, -1.0, static_cast<double>(count)) + 1.0; }

double signIntegral(double x, int count) {
  const double y = windowIntegral(x, count);
  const double phase = y - 2.0 * std::floor(0.5 * y);
  return phase < 1.0 ? phase : 2.0 - phase;
}

}  // namespace

Texture::Texture(const Rectangle& rectangle, int index)
    : half_u_(static_cast<float>(rectangle.half_u)), half_v_(static_cast<float>(rectangle.half_v)) {
  cv::Mat picture = paint(2.0 * rectangle.half_u, 2.0 * rectangle.half_v, kTexel_m, index);
  while (true) {
    cv::Mat padded;
    cv::copyMakeBorder(picture, padded, kPadding, kPadding, kPadding, kPadding, cv::BORDER_REPLICATE);
    Level level;
    level.picture = padded;
    level.per_u = 0.5F * static_cast<float>(picture.cols) / half_u_;
    level.per_v = 0.5F * static_cast<float>(picture.rows) / half_v_;
    // Texel i covers [i, i + 1] of the width, so its centre is at i + 0.5.
    level.first_u = 0.5F * static_cast<float>(picture.cols) + kPadding - 0.5F;
    level.first_v = 0.5F * static_cast<float>(picture.rows) + kPadding - 0.5F;
    level.data = level.picture.ptr<std::uint8_t>();
    level.step = static_cast<std::ptrdiff_t>(level.picture.step[0]);
    levels_.push_back(level);
    if (std::min(picture.cols, picture.rows) < 16) break;
    cv::resize(picture, picture, cv::Size((picture.cols + 1) / 2, (picture.rows + 1) / 2), 0, 0, cv::INTER_AREA);
  }
}

float Texture::level(float footprint_m) const {
  return std::clamp(std::log2(footprint_m / kTexel_m), 0.0F, static_cast<float>(levels_.size()) - 1.001F);
}

BoardPattern::BoardPattern(const BoardGeometry& board)
    : cols_(board.cols), rows_(board.rows), square_(board.square_m) {}

double BoardPattern::gray(double a, double b, double width_a, double width_b) const {
  const double s = columnOf(a), t = rowOf(b);
  const double ds = std::max(width_a / square_, 1e-6), dt = std::max(width_b / square_, 1e-6);
  const double s0 = s - 0.5 * ds, s1 = s + 0.5 * ds, t0 = t - 0.5 * dt, t1 = t + 0.5 * dt;
  const double window = (windowIntegral(s1, cols_) - windowIntegral(s0, cols_)) / ds *
                        (windowIntegral(t1, rows_) - windowIntegral(t0, rows_)) / dt;
  const double sign = (signIntegral(s1, cols_) - signIntegral(s0, cols_)) / ds *
                      (signIntegral(t1, rows_) - signIntegral(t0, rows_)) / dt;
  // Black where the signs agree, as on the square before the origin, where both are +1.
  return kWhite - (kWhite - kBlack) * 0.5 * (window + sign);
}

bool BoardPattern::uniform(double a, double b, double reach_a, double reach_b) const {
  const double s = columnOf(a), t = rowOf(b), ds = reach_a / square_, dt = reach_b / square_;
  const bool beside = s + ds < -1.0 || s - ds > cols_ || t + dt < -1.0 || t - dt > rows_;
  return beside || (std::floor(s - ds) == std::floor(s + ds) && std::floor(t - dt) == std::floor(t + dt));
}

}  // namespace cocalib::sim
