#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "cocalib/sim/appearance.h"
#include "cocalib/sim/scenario.h"

namespace cocalib::sim {

/// What goes wrong with a scenario's pictures (Scenario::Camera::Faults): some are lost, some are black, the brightness
/// steps, something that belongs to nothing else in the scene passes before the camera. Immutable after construction;
/// safe from any thread.
class PictureFaults {
 public:
  explicit PictureFaults(const Scenario& scenario);

  /// Whether picture k never arrives.
  bool isDropped(int k) const;

  /// Changes the light of picture k (CV_32FC1), as it falls through the lens: before blur and noise.
  void apply(int k, cv::Mat& image) const;

 private:
  double brightness(double t) const;
  /// A band from the upper to the lower border that swings from side to side, its own picture on it.
  void drawObject(double t, cv::Mat& image) const;

  Scenario scenario_;
  double object_px_;  ///< width of the moving object
  std::optional<Texture> object_;
};

}  // namespace cocalib::sim
