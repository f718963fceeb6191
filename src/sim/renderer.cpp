#include "cocalib/sim/renderer.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "cocalib/sim/camera.h"
#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

constexpr int kTile_px = 16;
constexpr int kParts = 4;  // an edge pixel is split in kParts x kParts
constexpr std::size_t kNoiseCount = 1U << 20U;
const double kWidestTangent = std::tan(85.0 * 3.141592653589793 / 180.0);

const View* nearestOf(const Views& views, const Eigen::Vector2f& ray) {
  const View* nearest = nullptr;
  float best = 0.0F;
  for (const View* view : views) {
    const float inverse_depth = view->inverseDepth(ray);
    if (inverse_depth <= best) continue;
    best = inverse_depth;
    nearest = view;
  }
  return nearest;
}

}  // namespace

Renderer::Renderer(const Scenario& scenario, const Scene& scene)
    : scenario_(scenario),
      scene_(scene),
      T_I_C_(scenario.camera.T_imu_camera()),
      width_(scenario.camera.width),
      height_(scenario.camera.height),
      pattern_(scenario.board.geometry()),
      faults_(scenario) {
  const CameraModel camera = scenario.camera.cameraModel();
  corner_rays_.reserve(static_cast<std::size_t>(width_ + 1) * (height_ + 1));
  for (int row = 0; row <= height_; ++row) {
    for (int col = 0; col <= width_; ++col) {
      const std::optional<Eigen::Vector3d> ray = camera.unproject({col - 0.5, row - 0.5});
      if (!ray || ray->head<2>().norm() > kWidestTangent * ray->z()) {
        throw std::invalid_argument(
            "camera: pictures can be drawn only for views under 85 deg off the axis in every pixel");
      }
      corner_rays_.push_back((ray->head<2>() / ray->z()).cast<float>());
    }
  }
  for (int row = 0; row < height_; ++row) {
    for (int col = 0; col < width_; ++col) center_rays_.push_back(rayIn(col, row, 0.5F, 0.5F));
  }
  for (std::size_t i = 0; i < scene.rectangles().size(); ++i) {
    if (!scene.rectangles()[i].is_board) textures_.emplace_back(scene.rectangles()[i], static_cast<int>(i));
  }
  Random random(scenario.seed, Random::Stream::kPixels);
  noise_.resize(kNoiseCount + static_cast<std::size_t>(width_));
  for (float& value : noise_) value = static_cast<float>(random.normal());
}

Tile Renderer::tileAt(int col, int row, int last_row) const {
  Tile tile;
  tile.col = col;
  tile.row = row;
  tile.last_col = std::min(col + kTile_px, width_);
  tile.last_row = last_row;
  Eigen::Vector2f low = cornerRay(col, row), high = low;
  const auto include = [&](int x, int y) {
    low = low.cwiseMin(cornerRay(x, y));
    high = high.cwiseMax(cornerRay(x, y));
  };
  // Neighbouring pixels have neighbouring rays: the border of the tile encloses the rays of its inside.
  for (int x = col; x <= tile.last_col; ++x) include(x, row), include(x, last_row);
  for (int y = row; y <= last_row; ++y) include(col, y), include(tile.last_col, y);
  tile.center = 0.5F * (low + high);
  tile.half = 0.5F * (high - low);
  return tile;
}

Eigen::Matrix2f Renderer::rayStep(int col, int row) const {
  const Eigen::Vector2f &r00 = cornerRay(col, row), &r10 = cornerRay(col + 1, row), &r01 = cornerRay(col, row + 1),
                        &r11 = cornerRay(col + 1, row + 1);
  Eigen::Matrix2f step;
  step << 0.5F * (r10 + r11 - r00 - r01), 0.5F * (r01 + r11 - r00 - r10);
  return step;
}

Eigen::Vector2f Renderer::rayIn(int col, int row, float x, float y) const {
  const Eigen::Vector2f top = cornerRay(col, row) + x * (cornerRay(col + 1, row) - cornerRay(col, row));
  const Eigen::Vector2f bottom = cornerRay(col, row + 1) + x * (cornerRay(col + 1, row + 1) - cornerRay(col, row + 1));
  return top + y * (bottom - top);
}

float Renderer::shadePart(const View& view, const Eigen::Vector2f& ray, const Eigen::Matrix2f& ray_step,
                          int parts) const {
  const View::Footprint f = view.footprint(ray, ray_step);
  if (view.index == scene_.boardIndex()) {
    return static_cast<float>(pattern_.gray(f.a, f.b, f.J.row(0).norm() / parts, f.J.row(1).norm() / parts));
  }
  const Texture& texture = textures_[view.index];
  return texture.gray(f.a, f.b, texture.level(std::max(f.J.col(0).norm(), f.J.col(1).norm()) / parts));
}

float Renderer::shadePixel(const View& view, int col, int row) const {
  const Eigen::Matrix2f step = rayStep(col, row);
  if (view.index == scene_.boardIndex()) {
    const View::Footprint f = view.footprint(centerRay(col, row), step);
    // Half a pixel each way and a tenth more for the change of perspective within it.
    const Eigen::Vector2f reach = 0.55F * f.J.cwiseAbs().rowwise().sum();
    if (!pattern_.uniform(f.a, f.b, reach[0], reach[1])) return shadeEdge({&view}, col, row);
  }
  return shadePart(view, centerRay(col, row), step, 1);
}

float Renderer::shadeEdge(const Views& views, int col, int row) const {
  const Eigen::Matrix2f step = rayStep(col, row);
  float sum = 0.0F;
  for (int i = 0; i < kParts; ++i) {
    for (int j = 0; j < kParts; ++j) {
      const Eigen::Vector2f ray = rayIn(col, row, (j + 0.5F) / kParts, (i + 0.5F) / kParts);
      const View* nearest = views.size() == 1 ? views.front() : nearestOf(views, ray);
      if (nearest != nullptr) sum += shadePart(*nearest, ray, step, kParts);
    }
  }
  return sum / (kParts * kParts);
}

void Renderer::drawCovered(const View& view, const Tile& tile, float weight, cv::Mat& image) const {
  if (view.index == scene_.boardIndex()) {
    for (int row = tile.row; row < tile.last_row; ++row) {
      for (int col = tile.col; col < tile.last_col; ++col) {
        image.at<float>(row, col) += weight * shadePixel(view, col, row);
      }
    }
    return;
  }
  const Texture& texture = textures_[view.index];
  const int right = tile.last_col - 1, bottom = tile.last_row - 1;
  // The level of detail changes slowly: it is interpolated from the corners of the tile.
  const auto levelAt = [&](int col, int row) {
    const View::Footprint f = view.footprint(centerRay(col, row), rayStep(col, row));
    return texture.level(std::max(f.J.col(0).norm(), f.J.col(1).norm()));
  };
  const float l00 = levelAt(tile.col, tile.row), l10 = levelAt(right, tile.row);
  const float l01 = levelAt(tile.col, bottom), l11 = levelAt(right, bottom);
  for (int row = tile.row; row < tile.last_row; ++row) {
    const float y = static_cast<float>(row - tile.row) / std::max(1, bottom - tile.row);
    const float left_level = l00 + y * (l01 - l00);
    const float level_step = (l10 + y * (l11 - l10) - left_level) / std::max(1, right - tile.col);
    float* pixels = image.ptr<float>(row);
    for (int col = tile.col; col < tile.last_col; ++col) {
      const Eigen::Vector2f& ray = centerRay(col, row);
      const float depth = 1.0F / affine(view.N, ray);
      const float level = left_level + level_step * static_cast<float>(col - tile.col);
      pixels[col] += weight * texture.gray(affine(view.A, ray) * depth, affine(view.B, ray) * depth, level);
    }
  }
}

void Renderer::drawMixed(const Views& views, const Tile& tile, float weight, cv::Mat& image) const {
  const int cols = tile.last_col - tile.col + 1, rows = tile.last_row - tile.row + 1;
  const View* nearest[(kTile_px + 1) * (kTile_px + 1)];
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) nearest[y * cols + x] = nearestOf(views, cornerRay(tile.col + x, tile.row + y));
  }
  for (int y = 0; y + 1 < rows; ++y) {
    for (int x = 0; x + 1 < cols; ++x) {
      const View* const* corner = nearest + y * cols + x;
      const bool uniform =
          corner[0] != nullptr && corner[0] == corner[1] && corner[0] == corner[cols] && corner[0] == corner[cols + 1];
      const int col = tile.col + x, row = tile.row + y;
      image.at<float>(row, col) += weight * (uniform ? shadePixel(*corner[0], col, row) : shadeEdge(views, col, row));
    }
  }
}

void Renderer::drawRows(const Pose& T_W_C, int first, int last, float weight, cv::Mat& image) const {
  const std::vector<View> views = viewsFrom(scene_, T_W_C);
  for (int row = first; row < last; row += kTile_px) {
    for (int col = 0; col < width_; col += kTile_px) {
      const Tile tile = tileAt(col, row, std::min(row + kTile_px, last));
      const TileContent content = contentOf(tile, views);
      if (content.covered) {
        drawCovered(*content.views.front(), tile, weight, image);
      } else {
        drawMixed(content.views, tile, weight, image);
      }
    }
  }
}

cv::Mat Renderer::renderStill(const Pose& T_W_C) const {
  cv::Mat image(height_, width_, CV_32FC1, cv::Scalar(0.0));
  drawRows(T_W_C, 0, height_, 1.0F, image);
  return image;
}

double Renderer::blurLength(const Trajectory& trajectory, double t) const {
  const Trajectory::Kinematics k = trajectory.at(t);
  constexpr double kClose_m = 1.0;  // hardly anything is nearer
  const double focal = 0.5 * (scenario_.camera.intrinsics[0] + scenario_.camera.intrinsics[1]);
  return focal * scenario_.camera.exposure_s * (k.omega_I.norm() + k.v_W.norm() / kClose_m);
}

cv::Mat Renderer::expose(const Trajectory& trajectory, double t) const {
  const Scenario::Camera& camera = scenario_.camera;
  // One instant per pixel of blur, so that the smear has no steps.
  const int instants = std::clamp(static_cast<int>(std::ceil(blurLength(trajectory, t))) + 1, 1, 40);
  const bool rolling = camera.line_delay_s > 0.0;
  const int rows_at_once = rolling ? 1 : height_;
  cv::Mat image(height_, width_, CV_32FC1, cv::Scalar(0.0));
  for (int i = 0; i < instants; ++i) {
    const double instant = t + camera.exposure_s * ((i + 0.5) / instants - 0.5);
    for (int row = 0; row < height_; row += rows_at_once) {
      const double delay = rolling ? camera.line_delay_s * (row - 0.5 * (height_ - 1)) : 0.0;
      drawRows(trajectory.T_W_I(instant + delay) * T_I_C_, row, row + rows_at_once, 1.0F / instants, image);
    }
  }
  return image;
}

cv::Mat Renderer::render(const Trajectory& trajectory, int k) const {
  const Scenario::Camera& camera = scenario_.camera;
  cv::Mat image = expose(trajectory, imageTime(scenario_, k));
  faults_.apply(k, image);
  if (camera.blur_px > 0.0) {
    const int reach = static_cast<int>(std::ceil(4.0 * camera.blur_px));
    cv::GaussianBlur(image, image, cv::Size(2 * reach + 1, 2 * reach + 1), camera.blur_px, camera.blur_px,
                     cv::BORDER_REPLICATE);
  }
  Random random(scenario_.seed, Random::Stream::kPixels, static_cast<std::uint64_t>(k) + 1U);
  cv::Mat picture(height_, width_, CV_8UC1);
  for (int row = 0; row < height_; ++row) {
    const float* noise = noise_.data() + random.bits() % kNoiseCount;
    const float* in = image.ptr<float>(row);
    std::uint8_t* out = picture.ptr<std::uint8_t>(row);
    const float sigma = static_cast<float>(camera.noise);
    for (int col = 0; col < width_; ++col) {
      out[col] = static_cast<std::uint8_t>(std::clamp(in[col] + sigma * noise[col] + 0.5F, 0.0F, 255.0F));
    }
  }
  return picture;
}

}  // namespace cocalib::sim
