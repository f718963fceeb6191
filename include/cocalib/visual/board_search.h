#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Looks for the chessboard in the whole picture (cv::findChessboardCornersSB, halved until it is at most 1000 px
/// wide).
/// @param coarse  halve once more: a third of the time; finds boards whose squares span some 12 px and more
/// @return a rough T_C_B, good to about a pixel, never mirrored (z points into the board); half turns (and quarter
/// turns
///         of a square board) are not told apart
std::optional<Pose> searchBoard(const cv::Mat& gray, const BoardGeometry& board, const CameraModel& camera,
                                bool coarse = false);

}  // namespace cocalib
