#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Finds the chessboard's inner corners in pictures and keeps their numbering consistent over a run.
///
/// Full-frame search (cv::findChessboardCornersSB) is slow and done only now and then (`search_period_s`) while the
/// board is not tracked. Once found, the corners are predicted from the last pictures, from the rotation the caller
/// predicts with the gyro or from setPredictedPose(), measured by refineCorner(), and checked against one board pose.
/// A board that is only partly in view is refused.
///
/// Numbering: row by row, x cross y points into the board. A board with an odd number of columns plus rows shows by its
/// colours which way round it is: the square between the corners 0, 1 and cols is a dark one. Any other board looks the
/// same after half a turn (a square one perhaps after a quarter turn, too): its origin is decided at first so that x
/// points right in the picture, then by continuity; after a loss by setPredictedPose(), else by the rotations given
/// since the loss, else by the assumption that the camera still has the attitude it had. Not thread-safe.
/// Deterministic. Never throws on data.
class BoardDetector {
 public:
  struct Params {
    double search_period_s = 0.4;      ///< between full-frame searches while the board is lost
    double max_reprojection_px = 1.0;  ///< RMS of the board-pose fit above which a picture is refused
  };
  /// @throws std::invalid_argument for a board under 3x3 corners, a square or parameters that are not positive
  BoardDetector(const BoardGeometry& board, const CameraModel& camera, const Params& params);

  /// Corners in this picture. @param R_Cnow_Cprev rotation of the camera since the previous call, if the caller knows
  /// it
  std::optional<BoardObservation> detect(const ImageFrame& image,
                                         const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev = std::nullopt);

  /// Pose T_C_B fitted to the last accepted observation.
  const std::optional<Pose>& lastPose() const { return T_C_B_; }

  /// Once the estimator knows where the board stands, it can say where to look and which half-turn is right.
  /// Holds for the next detect() only.
  void setPredictedPose(const Pose& T_C_B) { predicted_T_C_B_ = T_C_B; }

  /// Full-frame searches so far.
  int searches() const { return searches_; }

 private:
  struct View {
    TimeNs stamp = 0;
    Pose T_C_B;
  };
  struct Measurement {
    BoardObservation observation;
    Pose T_C_B;
  };

  void followRotation(const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev);
  std::vector<Pose> predictPoses(TimeNs stamp) const;
  std::optional<Measurement> measure(const cv::Mat& gray, const Pose& T_C_B, double max_shift_squares);
  std::optional<Measurement> search(const cv::Mat& gray);
  Pose chooseTurn(const cv::Mat& gray, const Pose& found_T_C_B);
  bool outOfView(const Pose& T_C_B) const;

  BoardGeometry board_;
  CameraModel camera_;
  Params params_;
  std::optional<Pose> T_C_B_;
  std::optional<Pose> predicted_T_C_B_;
  std::optional<View> last_, before_last_;          // newest accepted views
  std::optional<Eigen::Quaterniond> R_Cnow_Clast_;  // since last_, while the caller gives every rotation
  std::optional<TimeNs> last_search_;
  bool first_square_light_ = false;
  double blur_px_ = 0.8;
  int searches_ = 0;
};

/// Pose of the board from its corners: homography start, then least squares on the reprojection.
/// @param rms_px  where to put the RMS reprojection error, or null
std::optional<Pose> estimateBoardPose(const BoardObservation& observation, const BoardGeometry& board,
                                      const CameraModel& camera, double* rms_px = nullptr);

}  // namespace cocalib
