#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Finds out that the board in the pictures is not the one of the rig file. While no board of the given size has been
/// seen, one picture a second is searched for a chessboard of any size; three that agree are an answer. Costs nothing
/// once the right board was seen. Not thread-safe. Deterministic.
class BoardSizeCheck {
 public:
  explicit BoardSizeCheck(const BoardGeometry& board) : board_(board) {}

  /// The right board was seen: nothing is left to check.
  void confirm() { finished_ = true; }

  /// @return "the board in the pictures has 6 x 8 inner corners, not 5 x 7", once it is certain
  std::optional<std::string> look(const ImageFrame& image);

 private:
  BoardGeometry board_;
  bool finished_ = false;
  std::optional<TimeNs> last_look_;
  int looks_ = 0;
  std::vector<cv::Size> found_;
};

}  // namespace cocalib
