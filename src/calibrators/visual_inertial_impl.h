#pragma once

#include <deque>
#include <string>

#include "cocalib/calibrators/camera_exploration.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/calibrators/window_health.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/inertial/imu_inbox.h"
#include "cocalib/initialization/alignment.h"
#include "cocalib/measurements/stamp_order.h"
#include "cocalib/visual/board_detector.h"
#include "cocalib/visual/feature_tracker.h"

namespace cocalib {

/// Front end, start and window; visual_inertial_calibrator.cpp and visual_inertial_window.cpp implement it.
struct VisualInertialCalibrator::Impl {
  static constexpr int kStarving = 10;  // pictures in a row with few features, before it says so

  Impl(const VisualInertialParams& p, const ImuNoise& noise, const CameraModel& model,
       const std::optional<BoardGeometry>& b, const std::optional<Pose>& g)
      : params(p),
        guess(g),
        camera(model),
        board(b),
        tracker(model, FeatureTracker::Params()),
        exploration(model, b),
        window(windowParams(noise, model, b)) {
    if (!board) return;
    // A search costs as much as twenty tracked pictures; once the window predicts the board there is nothing left to
    // search.
    BoardDetector::Params detection;
    detection.search_period_s = 0.8;
    detector.emplace(*board, camera, detection);
  }
  static InertialWindow::Params windowParams(const ImuNoise& noise, const CameraModel& model,
                                             const std::optional<BoardGeometry>& board) {
    InertialWindow::Params out;
    out.imu_noise = noise;
    out.camera.emplace(model);
    out.camera->board = board;
    return out;
  }

  // What comes in.
  std::vector<VisualKeyframe> keyframesAfterAdvance();
  VisualKeyframe look(const ImageFrame& image);
  std::optional<Eigen::Quaterniond> predictRotation(TimeNs stamp) const;
  void predictBoard(TimeNs stamp);
  bool coveredByImu(TimeNs stamp) const;
  void advance();
  void take(VisualKeyframe keyframe);
  // What is made of it (visual_inertial_window.cpp).
  bool tryToStart();
  void forgetUselessPictures();
  void startWindow(const Alignment& alignment);
  void solve();
  bool solveWindow();
  void restart(const std::string& reason);
  void publish();
  bool starving() const { return hungry_images >= kStarving; }
  void say();
  std::vector<VisualKeyframe> takeKeyframes();

  VisualInertialParams params;
  std::optional<Pose> guess;
  CameraModel camera;
  std::optional<BoardGeometry> board;
  std::optional<BoardDetector> detector;
  FeatureTracker tracker;
  CameraExploration exploration;
  InertialWindow window;
  ImuInbox inbox;
  bool started = false;
  StampOrder order;     // of the pictures
  double effort = 1.0;  // share of the usual rate of pictures
  std::optional<TimeNs> last_tracks;
  std::deque<ImageFrame> images;        // that wait for inertial data,
  std::deque<VisualKeyframe> explored;  // before the start, newest initialization_s
  std::optional<TimeNs> last_try;
  std::deque<VisualKeyframe> waiting;  // and measurements that do
  std::deque<VisualKeyframe> unreported;
  /// Of the unreported ones, those of the last solve. Their stamps do not tell: the solve has moved the clock offset.
  std::size_t solved = 0;
  TimeNs last_solve = 0;
  FailedSolves failed;
  std::string why_anew;   ///< said until the mounting is found again
  int hungry_images = 0;  // in a row
  CalibrationEstimate estimate;
  CalibratorDiagnostics diagnostics;
};

}  // namespace cocalib
