#pragma once

#include <map>
#include <vector>

#include "cocalib/estimation/camera_group.h"

namespace cocalib {

/// Quadratics over camera poses, summed over all features before they are scattered to the states.
struct CameraGroup::Sums {
  explicit Sums(std::size_t frames) : H(frames, Matrix6d::Zero()), b(frames, Vector6d::Zero()), pairs(frames) {}
  const std::vector<TimedSensorPose>* poses = nullptr;
  std::vector<Matrix6d> H;
  std::vector<Vector6d> b;
  std::vector<std::map<int, Matrix6d>> pairs;  // [i][j], i < j
  double cost = 0.0;
  double corner_square_px = 0.0, track_square_px = 0.0;  // mean over both axes
  std::size_t corners = 0, track_observations = 0;
  TrackNoiseEstimator track_noise;
};

}  // namespace cocalib
