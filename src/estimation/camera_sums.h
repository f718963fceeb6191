#pragma once

#include <cstddef>
#include <vector>

#include "cocalib/estimation/camera_group.h"

namespace cocalib {

/// One landmark's observations; kept from one to the next, so that none of them allocates.
struct CameraGroup::Views {
  std::vector<int> frames;
  std::vector<double> times_s;      // since the first
  std::vector<std::size_t> places;  // the parts of the pictures that they lie in
  std::vector<Eigen::Vector2d> r;   // over the white part's sigma, as the Jacobians
  std::vector<Eigen::Matrix<double, 2, 6>> J_pose;
  std::vector<Eigen::Matrix<double, 2, 3>> J_landmark;
  // Rows of the information times all Jacobians and residuals, and the whitened square of all residuals.
  Eigen::MatrixXd information;
  std::vector<Eigen::Matrix<double, 2, 3>> weighed_J;
  std::vector<Eigen::Vector2d> weighed_r;
  std::vector<Eigen::Matrix<double, 2, 3>> freed_J;  // weighed_J times the inverse of the landmark's own information
  double squared = 0.0;

  void clear();
  double at(std::size_t i, std::size_t j) const {
    return information(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
  }
  double degrees() const { return 2.0 * static_cast<double>(frames.size()) - 3.0; }
};

/// What couples one frame to later ones. A track couples few, so that a search is shorter than a tree.
struct FramePairs {
  std::vector<int> frames;
  std::vector<Matrix6d> H;

  Matrix6d& with(int frame) {
    std::size_t i = 0;
    while (i < frames.size() && frames[i] != frame) ++i;
    if (i == frames.size()) {
      frames.push_back(frame);
      H.emplace_back(Matrix6d::Zero());
    }
    return H[i];
  }
};

/// Quadratics over camera poses, summed over all features before they are scattered to the states.
struct CameraGroup::Sums {
  explicit Sums(std::size_t frames) : H(frames, Matrix6d::Zero()), b(frames, Vector6d::Zero()), pairs(frames) {}
  const std::vector<TimedSensorPose>* poses = nullptr;
  std::vector<Matrix6d> H;
  std::vector<Vector6d> b;
  std::vector<FramePairs> pairs;
  Views views;  // of the landmark that is being added
  double cost = 0.0;
  double corner_square_px = 0.0, track_square_px = 0.0;  // mean over both axes
  std::size_t corners = 0, track_observations = 0;
  TrackNoiseEstimator track_noise;
};

}  // namespace cocalib
