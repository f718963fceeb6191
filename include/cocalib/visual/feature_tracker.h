#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"
#include "cocalib/visual/patch_alignment.h"

namespace cocalib {

/// Grid-balanced KLT tracks of natural features, predicted by the gyro once the mounting is known. KLT leads from
/// picture to picture; the position is then measured against the picture in which the track began, so that errors do
/// not add up. A track whose surroundings look different by now ends, and a new one begins in its place if KLT leads
/// back to where it came from. Steps of the brightness are made up for. Outliers go by an epipolar RANSAC (over the
/// direction of translation alone where the rotation is given). Not thread-safe. Deterministic, whatever OpenCV's
/// number of threads. Never throws on data.
class FeatureTracker {
 public:
  struct Params {
    int max_features = 150;
    int grid_cols = 8, grid_rows = 5;  ///< features are spread evenly over these cells
    double min_distance_px = 20.0;
    double max_forward_backward_px = 0.5;
    double ransac_px = 1.5;  ///< epipolar threshold
  };
  /// @throws std::invalid_argument for parameters that are not positive
  FeatureTracker(const CameraModel& camera, const Params& params);

  /// Tracks into the next picture and tops up with new corners. Tracks keep their id while they live.
  /// @param R_Cnow_Cprev  rotation p_now = R p_prev of the camera since the previous picture, if known
  /// @param mask_px       convex outline (e.g. of the chessboard) where no new feature is taken; may be empty
  std::vector<TrackObservation> track(const ImageFrame& image,
                                      const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev = std::nullopt,
                                      const std::vector<Eigen::Vector2f>& mask_px = {});

  /// Forgets all tracks (time jump, blackout).
  void reset();

 private:
  struct Track {
    std::uint32_t id = 0;
    cv::Point2f px;
    Eigen::Vector3d bearing;  // unit, in the camera frame
    std::shared_ptr<const ReferencePatch> patch;
    Eigen::Matrix2d A = Eigen::Matrix2d::Identity();  // how the patch appears
  };

  /// Where the tracks should be now, by rotation_.
  std::vector<cv::Point2f> predict(const std::vector<Track>& tracks) const;
  /// Rotation since the previous picture from some of the tracks, starting from the last one.
  Eigen::Quaterniond guessRotation(const std::vector<cv::Mat>& pyramid) const;
  std::vector<Track> follow(const cv::Mat& gray, const std::vector<cv::Mat>& pyramid, bool rotation_known);
  /// The tracks that are found in the picture, right or wrong; their bearings are still those before.
  std::vector<Track> followed(const cv::Mat& gray, const std::vector<cv::Mat>& pyramid);
  /// Moves a track from where KLT leaves it to where its reference says; false where it says nothing.
  static bool measure(const cv::Mat& gray, Track* track);
  /// Ends a track and begins another in its place; false where there is nothing to follow.
  bool beginAnew(const cv::Mat& gray, Track* track);
  /// The forward-backward check: which places KLT leads back to where they came from.
  std::vector<bool> returns(const std::vector<cv::Mat>& pyramid, const std::vector<cv::Point2f>& before,
                            const std::vector<cv::Point2f>& now) const;
  /// The picture as bright as the previous one, where the brightness has stepped; otherwise itself.
  cv::Mat evenOut(const cv::Mat& gray);
  void topUp(const cv::Mat& gray, const std::vector<Eigen::Vector2f>& mask_px);
  void topUpCell(const cv::Mat& gray, const cv::Rect& cell, std::size_t wanted, const std::vector<cv::Point2f>& mask);

  CameraModel camera_;
  Params params_;
  std::vector<Track> tracks_;                                     // in the previous picture
  std::vector<cv::Mat> pyramid_;                                  // of the previous picture
  double mean_ = 0.0, contrast_ = 0.0;                            // of its grey levels
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();  // R_Cnow_Cprev, given or guessed
  std::uint32_t next_id_ = 0;
  int next_cell_ = 0;  // where topUp() goes on
};

/// Relative rotation p_b = R p_a between two pictures from their common tracks (essential matrix by RANSAC, falling
/// back to a pure rotation where the translation is too small to tell), with the number of inliers; nothing below 15
/// common tracks.
struct RelativeRotation {
  Eigen::Quaterniond R_b_a;
  int inliers = 0;
};
std::optional<RelativeRotation> relativeRotation(const std::vector<TrackObservation>& a,
                                                 const std::vector<TrackObservation>& b, const CameraModel& camera);

}  // namespace cocalib
