#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// What one inner corner of the chessboard should look like in a picture: where it is and how the two lines that cross
/// there run, to second order, so that perspective and lens distortion do not pull the corner aside.
///
/// A step of s squares along the board's x lands at px + x_edge s + x_bend s^2 / 2 (y alike).
struct CornerPrediction {
  Eigen::Vector2d px;              ///< raw pixel
  Eigen::Vector2d x_edge, y_edge;  ///< [px / square]
  Eigen::Vector2d x_bend, y_bend;  ///< [px / square^2]
  bool light_diagonal = false;     ///< the squares at (+,+) and (-,-) of the corner are the light ones
};

/// A corner as measured.
struct RefinedCorner {
  Eigen::Vector2d px;
  double contrast = 0.0;  ///< half the step between light and dark squares [grey levels], positive as predicted
  double blur_px = 0.0;   ///< standard deviation of the edges' blur, mean of both lines
  double residual = 0.0;  ///< RMS of the picture against the model [grey levels]
};

/// Predictions of all corners (row by row) for a board at T_C_B; nothing if any corner or its neighbourhood cannot be
/// projected, or the board shows its back, is seen nearly edge-on or too small.
/// @param first_square_light  the square between the corners 0, 1 and cols is a light one
std::optional<std::vector<CornerPrediction>> predictCorners(const Pose& T_C_B, const BoardGeometry& board,
                                                            const CameraModel& camera, bool first_square_light);

/// Difference (light - dark) / 2 of the four squares around a corner as predicted, from four samples [grey levels];
/// negative where light and dark are swapped. Zero where a sample falls outside the picture.
double cornerContrast(const cv::Mat& gray, const CornerPrediction& prediction);

/// The one shift of the whole board, within max_shift_px and to about a pixel, under which its corners fit the picture
/// best. Light and dark fields count with their sign, hence a shift by one square scores worst and one by a diagonal
/// loses a row and a column.
Eigen::Vector2d findBoardShift(const cv::Mat& gray, const std::vector<CornerPrediction>& predictions,
                               double max_shift_px);

/// Least-squares fit of the picture around a corner: two crossing edges with Gaussian blur, two grey levels and an even
/// slope of the light; the window follows the board's lines and reaches 0.42 of a square (3 to 9 px) each way.
/// @param start_blur_px   first guess of the blur [px, 1 sigma]
/// @param free_blur       estimate the blur; otherwise it stays, which converges from further away
/// @param tolerance_px    the fit ends with the first step shorter than this
/// @return nothing where the fit diverges, leaves the window or the picture
std::optional<RefinedCorner> refineCorner(const cv::Mat& gray, const CornerPrediction& prediction, double start_blur_px,
                                          bool free_blur, int iterations, double tolerance_px);

}  // namespace cocalib
