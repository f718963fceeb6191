#include "cocalib/sim/picture_faults.h"

#include <algorithm>
#include <cmath>

#include "cocalib/sim/camera.h"
#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

// The object's picture is painted as if it were a surface of the scene that shows a texel on every pixel.
constexpr double kMetersPerPixel = 0.004;
constexpr int kObjectTexture = 1000;  // a number that no surface of the scene has
constexpr double kSwing_Hz = 0.11, kBob_Hz = 0.23, kBob_px = 40.0;

Rectangle objectSurface(double width_px, double height_px) {
  Rectangle surface;
  surface.half_u = 0.5 * kMetersPerPixel * width_px;
  surface.half_v = 0.5 * kMetersPerPixel * height_px;
  return surface;
}

}  // namespace

PictureFaults::PictureFaults(const Scenario& scenario)
    : scenario_(scenario), object_px_(scenario.camera.faults.moving_object * scenario.camera.width) {
  if (object_px_ < 1.0) return;
  object_.emplace(objectSurface(object_px_, scenario.camera.height + 4.0 * kBob_px), kObjectTexture);
}

bool PictureFaults::isDropped(int k) const {
  const double share = scenario_.camera.faults.dropped;
  return share > 0.0 &&
         Random(scenario_.seed, Random::Stream::kFaults, static_cast<std::uint64_t>(k)).uniform() < share;
}

double PictureFaults::brightness(double t) const {
  const Scenario::Camera::Faults& faults = scenario_.camera.faults;
  if (t >= faults.blackout_start_s && t < faults.blackout_start_s + faults.blackout_s) return 0.0;
  if (faults.brightness_period_s <= 0.0) return 1.0;
  // Levels have a stream of indices of their own, far beyond any picture's number.
  constexpr std::uint64_t kLevels = 1ULL << 40U;
  const auto level = static_cast<std::uint64_t>(std::max(0.0, t / faults.brightness_period_s));
  Random random(scenario_.seed, Random::Stream::kFaults, kLevels + level);
  return std::pow(faults.brightness_factor, random.uniform(-1.0, 1.0));
}

void PictureFaults::drawObject(double t, cv::Mat& image) const {
  const double turn = 2.0 * M_PI * t;
  const double center_x = 0.5 * image.cols * (1.0 + std::sin(kSwing_Hz * turn));
  const double center_y = 0.5 * image.rows + kBob_px * std::sin(kBob_Hz * turn);
  const int first = std::max(0, static_cast<int>(std::ceil(center_x - 0.5 * object_px_)));
  const int end = std::min(image.cols, static_cast<int>(std::ceil(center_x + 0.5 * object_px_)));
  for (int row = 0; row < image.rows; ++row) {
    float* pixels = image.ptr<float>(row);
    const auto b = static_cast<float>(kMetersPerPixel * (row - center_y));
    for (int col = first; col < end; ++col) {
      pixels[col] = object_->gray(static_cast<float>(kMetersPerPixel * (col - center_x)), b, 0.0F);
    }
  }
}

void PictureFaults::apply(int k, cv::Mat& image) const {
  const double t = imageTime(scenario_, k);
  if (object_) drawObject(t, image);
  const double factor = brightness(t);
  if (factor != 1.0) image.convertTo(image, -1, factor);
}

}  // namespace cocalib::sim
