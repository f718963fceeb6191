#include "cocalib/visual/board_detector.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "cocalib/visual/board_pose.h"
#include "cocalib/visual/board_search.h"
#include "cocalib/visual/corner_refinement.h"

namespace cocalib {
namespace {

constexpr double kMaxCoastS = 0.5;        // how long a motion is extrapolated without a view
constexpr double kMaxMotionGapS = 0.3;    // between two views from which a velocity is taken
constexpr double kUnknownRollRad = 0.12;  // tried both ways: 2.4 rad/s at 20 pictures a second
constexpr double kPatience = 5.0;         // how much rarer searches are where the caller predicts the board
constexpr double kShiftSquares = 2.0;     // by how much a prediction may be off
constexpr int kCoarseIterations = 5, kFineIterations = 8;
constexpr double kCoarseTolerancePx = 0.15, kFineTolerancePx = 0.01;
constexpr std::size_t kCoarseStride = 2;  // every second corner
constexpr std::size_t kMinCoarseCorners = 4;
constexpr double kMinCoarseShare = 0.6;  // of those tried, for a pose good enough to predict all
constexpr double kMaxCoarseRmsSquares = 0.15;
constexpr double kMinContrast = 6.0;        // grey levels, half the step
constexpr double kMinContrastShare = 0.35;  // of the median corner's
constexpr double kMaxResidualShare = 0.35;  // RMS misfit of the picture over the contrast
constexpr double kMaxCornerError = 3.0;     // over max_reprojection_px

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

double meanSquarePx(const std::vector<CornerPrediction>& predictions) {
  double sum = 0.0;
  for (const CornerPrediction& prediction : predictions) sum += prediction.x_edge.norm() + prediction.y_edge.norm();
  return 0.5 * sum / static_cast<double>(predictions.size());
}

bool allPlausible(const std::vector<RefinedCorner>& corners) {
  std::vector<double> contrasts;
  for (const RefinedCorner& corner : corners) contrasts.push_back(corner.contrast);
  const double min_contrast = std::max(kMinContrast, kMinContrastShare * median(contrasts));
  return std::all_of(corners.begin(), corners.end(), [&](const RefinedCorner& corner) {
    return corner.contrast >= min_contrast && corner.residual <= kMaxResidualShare * corner.contrast;
  });
}

}  // namespace

BoardDetector::BoardDetector(const BoardGeometry& board, const CameraModel& camera, const Params& params)
    : board_(board), camera_(camera), params_(params) {
  if (board.cols < 3 || board.rows < 3) throw std::invalid_argument("board must have at least 3 x 3 inner corners");
  if (!(board.square_m > 0.0)) throw std::invalid_argument("board's square must be > 0");
  if (!(params.search_period_s >= 0.0)) throw std::invalid_argument("search_period_s must be >= 0");
  if (!(params.max_reprojection_px > 0.0)) throw std::invalid_argument("max_reprojection_px must be > 0");
}

std::optional<BoardObservation> BoardDetector::detect(const ImageFrame& image,
                                                      const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev) {
  followRotation(R_Cnow_Cprev);
  if (last_ && image.stamp <= last_->stamp) {  // time ran backwards: keep the attitude, forget the motion
    last_.reset();
    before_last_.reset();
  }
  if (last_search_ && image.stamp < *last_search_) last_search_.reset();
  std::optional<Measurement> found;
  if (!image.gray.empty() && image.gray.type() == CV_8UC1 && image.gray.cols == camera_.width() &&
      image.gray.rows == camera_.height()) {
    const std::vector<Pose> predictions = predictPoses(image.stamp);
    for (const Pose& T_C_B : predictions) {
      found = measure(image.gray, T_C_B, kShiftSquares);
      if (found) break;
    }
    // Where its place is known, a board that was not found there is most likely hidden or too oblique.
    const double period_s = params_.search_period_s * (predicted_T_C_B_ ? kPatience : 1.0);
    const bool due = !last_search_ || toSeconds(image.stamp - *last_search_) >= period_s;
    if (!found && due && (predictions.empty() || !outOfView(predictions.front()))) {
      last_search_ = image.stamp;
      found = search(image.gray);
    }
  }
  predicted_T_C_B_.reset();
  if (!found) return std::nullopt;
  before_last_ = last_;
  last_ = View{image.stamp, found->T_C_B};
  T_C_B_ = found->T_C_B;
  R_Cnow_Clast_ = Eigen::Quaterniond::Identity();
  return found->observation;
}

void BoardDetector::followRotation(const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev) {
  if (!R_Cnow_Cprev) {
    R_Cnow_Clast_.reset();
  } else if (R_Cnow_Clast_) {
    R_Cnow_Clast_ = (*R_Cnow_Cprev * *R_Cnow_Clast_).normalized();
  }
}

std::vector<Pose> BoardDetector::predictPoses(TimeNs stamp) const {
  std::vector<Pose> poses;
  if (predicted_T_C_B_) poses.push_back(*predicted_T_C_B_);
  if (!last_ || toSeconds(stamp - last_->stamp) > kMaxCoastS) return poses;
  const Pose& T_last = last_->T_C_B;
  Eigen::Quaterniond R_C_B = R_Cnow_Clast_ ? *R_Cnow_Clast_ * T_last.q : T_last.q;
  Eigen::Vector3d camera_B = T_last.inverse().t;
  if (before_last_) {
    const double gap_s = toSeconds(last_->stamp - before_last_->stamp);
    const double ratio = toSeconds(stamp - last_->stamp) / gap_s;
    if (gap_s <= kMaxMotionGapS && ratio <= 3.0) {
      const Pose& T_before = before_last_->T_C_B;
      camera_B += ratio * (camera_B - T_before.inverse().t);
      if (!R_Cnow_Clast_) R_C_B = expSo3(ratio * logSo3(T_last.q * T_before.q.conjugate())) * T_last.q;
    }
  }
  poses.push_back(Pose{R_C_B.normalized(), -(R_C_B * camera_B)});
  if (!before_last_ && !R_Cnow_Clast_) {
    // Nothing tells how the camera turns: a shift makes up for turns to the side, but not for a roll.
    for (const double roll : {-kUnknownRollRad, kUnknownRollRad}) {
      const Pose turn{expSo3({0.0, 0.0, roll}), Eigen::Vector3d::Zero()};
      poses.push_back(turn * Pose{R_C_B.normalized(), -(R_C_B * camera_B)});
    }
  }
  return poses;
}

bool BoardDetector::outOfView(const Pose& T_C_B) const {
  const auto predictions = predictCorners(T_C_B, board_, camera_, first_square_light_);
  if (!predictions) return false;  // no prediction to trust
  const double margin_px = kShiftSquares * meanSquarePx(*predictions);
  return std::any_of(predictions->begin(), predictions->end(),
                     [&](const CornerPrediction& prediction) { return !camera_.inImage(prediction.px, -margin_px); });
}

std::optional<BoardDetector::Measurement> BoardDetector::measure(const cv::Mat& gray, const Pose& T_C_B,
                                                                 double max_shift_squares) {
  auto predictions = predictCorners(T_C_B, board_, camera_, first_square_light_);
  if (!predictions) return std::nullopt;
  const double square_px = meanSquarePx(*predictions);
  if (max_shift_squares > 0.0) {
    const Eigen::Vector2d shift = findBoardShift(gray, *predictions, max_shift_squares * square_px);
    for (CornerPrediction& prediction : *predictions) prediction.px += shift;
  }
  // Coarse: a blurred model converges from afar; then one pose predicts every corner and its lines anew.
  const double coarse_blur_px = std::clamp(0.1 * square_px, 1.0, 2.5);
  std::vector<std::optional<Eigen::Vector2d>> coarse(predictions->size());
  std::size_t count = 0;
  for (std::size_t i = 0; i < coarse.size(); i += kCoarseStride) {
    const auto corner =
        refineCorner(gray, (*predictions)[i], coarse_blur_px, false, kCoarseIterations, kCoarseTolerancePx);
    if (!corner) continue;
    coarse[i] = corner->px;
    ++count;
  }
  if (count < kMinCoarseCorners || kCoarseStride * static_cast<double>(count) < kMinCoarseShare * coarse.size())
    return std::nullopt;
  double rms_px = 0.0;
  auto pose = refineBoardPose(T_C_B, coarse, board_, camera_, &rms_px);
  if (!pose || rms_px > std::max(kMaxCoarseRmsSquares * square_px, params_.max_reprojection_px)) return std::nullopt;
  predictions = predictCorners(*pose, board_, camera_, first_square_light_);
  if (!predictions) return std::nullopt;

  std::vector<RefinedCorner> fine;
  std::vector<std::optional<Eigen::Vector2d>> fine_px;
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    CornerPrediction& prediction = (*predictions)[i];
    // Where the lens is not known exactly, the coarse fit is the better start than the pose.
    if (coarse[i] && (*coarse[i] - prediction.px).norm() < 0.2 * square_px) prediction.px = *coarse[i];
    const auto corner = refineCorner(gray, prediction, blur_px_, true, kFineIterations, kFineTolerancePx);
    if (!corner || !camera_.inImage(corner->px)) return std::nullopt;
    fine.push_back(*corner);
    fine_px.emplace_back(corner->px);
  }
  if (!allPlausible(fine)) return std::nullopt;
  pose = refineBoardPose(*pose, fine_px, board_, camera_, &rms_px);
  if (!pose || rms_px > params_.max_reprojection_px) return std::nullopt;

  Measurement measurement{{}, *pose};
  std::vector<double> blurs;
  for (int i = 0; i < board_.cornerCount(); ++i) {
    const auto px = camera_.project(*pose * board_.corner(i));
    if (!px || (*px - fine[i].px).norm() > kMaxCornerError * params_.max_reprojection_px) return std::nullopt;
    measurement.observation.corners_px.push_back(fine[i].px.cast<float>());
    blurs.push_back(fine[i].blur_px);
  }
  blur_px_ = median(blurs);
  return measurement;
}

std::optional<BoardDetector::Measurement> BoardDetector::search(const cv::Mat& gray) {
  const bool coarse = searches_++ % 2 == 0;  // in turns: a fine search takes three times as long
  const std::optional<Pose> found = searchBoard(gray, board_, camera_, coarse);
  if (!found) return std::nullopt;
  blur_px_ = 0.8;
  return measure(gray, chooseTurn(gray, *found), 0.0);
}

Pose BoardDetector::chooseTurn(const cv::Mat& gray, const Pose& found_T_C_B) {
  // The attitude the board is expected to have; at the very first, x to the right.
  Eigen::Quaterniond expected = Eigen::Quaterniond::Identity();
  if (predicted_T_C_B_) {
    expected = predicted_T_C_B_->q;
  } else if (T_C_B_) {
    expected = R_Cnow_Clast_ ? *R_Cnow_Clast_ * T_C_B_->q : T_C_B_->q;
  }
  struct Candidate {
    Pose T_C_B;
    double contrast, angle;
  };
  std::vector<Candidate> candidates;
  const Eigen::Vector3d middle(0.5 * (board_.cols - 1) * board_.square_m, 0.5 * (board_.rows - 1) * board_.square_m,
                               0.0);
  const int step = board_.cols == board_.rows ? 1 : 2;
  for (int quarter = 0; quarter < 4; quarter += step) {
    const Eigen::Quaterniond turn = expSo3({0.0, 0.0, 0.5 * M_PI * quarter});
    const Pose T_C_B = found_T_C_B * Pose{turn, middle - turn * middle};
    const auto predictions = predictCorners(T_C_B, board_, camera_, false);
    double contrast = 0.0;
    if (predictions) {
      for (const CornerPrediction& corner : *predictions) {
        contrast += cornerContrast(gray, corner);
      }
    }
    candidates.push_back({T_C_B, contrast, T_C_B.q.angularDistance(expected)});
  }
  // A dark first square wins where both colours occur; where only one does, the board is made that way.
  const bool any_dark =
      std::any_of(candidates.begin(), candidates.end(), [](const auto& c) { return c.contrast > 0.0; });
  first_square_light_ = !any_dark;
  const Candidate* best = nullptr;
  for (const Candidate& candidate : candidates) {
    if (any_dark && candidate.contrast <= 0.0) continue;
    if (best == nullptr || candidate.angle < best->angle) best = &candidate;
  }
  return best->T_C_B;
}

}  // namespace cocalib
