#pragma once

#include <optional>

#include <opencv2/core/mat.hpp>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Finds the chessboard's inner corners in pictures and keeps their numbering consistent over a run.
///
/// Full-frame search (cv::findChessboardCornersSB) is slow and done only now and then (`search_period_s`) while the
/// board is not tracked. Once found, corners are predicted from the last pictures (and, once known, a rotation that the
/// caller predicts with the gyro), refined to sub-pixel, and checked against one homography-like board pose.
/// A board with an even number of squares both ways looks the same after half a turn: which end is the origin is
/// decided by continuity while tracked, and by setGravity() (or the previous choice) after a loss.
/// Not thread-safe. Deterministic.
class BoardDetector {
 public:
  struct Params {
    double search_period_s = 0.4;      ///< between full-frame searches while the board is lost
    double max_reprojection_px = 1.0;  ///< RMS of the board-pose fit above which a picture is refused
  };
  BoardDetector(const BoardGeometry& board, const CameraModel& camera, const Params& params);

  /// Corners in this picture. @param R_Cnow_Cprev rotation of the camera since the previous call, if the caller knows it
  std::optional<BoardObservation> detect(const ImageFrame& image,
                                         const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev = std::nullopt);

  /// Pose T_C_B fitted to the last accepted observation.
  const std::optional<Pose>& lastPose() const { return T_C_B_; }

  /// Once the estimator knows where the board stands, it can say where to look and which half-turn is right.
  void setPredictedPose(const Pose& T_C_B) { predicted_T_C_B_ = T_C_B; }

 private:
  BoardGeometry board_;
  CameraModel camera_;
  Params params_;
  std::optional<Pose> T_C_B_;
  std::optional<Pose> predicted_T_C_B_;
  // The helper that implements this file may add private members.
};

/// Pose of the board from its corners: homography start, then least squares on the reprojection.
/// @param rms_px  where to put the RMS reprojection error, or null
std::optional<Pose> estimateBoardPose(const BoardObservation& observation, const BoardGeometry& board,
                                      const CameraModel& camera, double* rms_px = nullptr);

}  // namespace cocalib
