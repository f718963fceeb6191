#pragma once

#include <optional>

#include <opencv2/core/mat.hpp>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Looks for the chessboard in the whole picture (cv::findChessboardCornersSB, halved until it is at most 1000 px wide).
/// @return a rough T_C_B, good to about a pixel, never mirrored (z points into the board); half turns (and quarter turns
///         of a square board) are not told apart
std::optional<Pose> searchBoard(const cv::Mat& gray, const BoardGeometry& board, const CameraModel& camera);

}  // namespace cocalib
