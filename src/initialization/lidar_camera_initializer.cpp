#include "cocalib/initialization/lidar_camera_initializer.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cocalib/initialization/plate_alignment.h"

namespace cocalib {
namespace {

constexpr int kMinViews = 3;
constexpr std::size_t kMaxHypotheses = 20000;

std::optional<LidarCameraStart> fail(std::string* reason, const std::string& text) {
  if (reason != nullptr) *reason = text;
  return std::nullopt;
}

std::string format(const char* pattern, double a, double b) {
  char text[300];
  std::snprintf(text, sizeof text, pattern, a, b);
  return text;
}

/// How well a plate is where the camera sees the board: 1 = exactly, <= 0: not the same.
double agreement(const PlatePair& pair, const Pose& T_L_C, const LidarCameraInitializerParams& params,
                 LidarCameraStart::View* view) {
  const double cosine = pair.plate->plane_L.normal.dot(T_L_C.q * pair.normal_C());
  view->normal_angle_rad = std::acos(std::max(-1.0, std::min(1.0, cosine)));
  view->centre_distance_m = (pair.plate->centre_L - T_L_C * pair.T_C_P.t).norm();
  const double angle = view->normal_angle_rad / params.max_normal_angle_rad;
  const double distance = view->centre_distance_m / params.max_centre_distance_m;
  return 1.0 - std::max(angle * angle, distance * distance);
}

using Choice = std::vector<LidarCameraStart::View>;

class PlateConsensus {
 public:
  PlateConsensus(const std::vector<BoardView>& views, const BoardGeometry& board,
                 const LidarCameraInitializerParams& params)
      : views_(views), params_(params) {
    const Pose T_B_P{Eigen::Quaterniond::Identity(), plateCentre(board)};
    for (const BoardView& view : views) T_C_P_.push_back(view.T_C_B * T_B_P);
  }

  PlatePair pair(std::size_t view, int plate) const {
    return {T_C_P_[view], &views_[view].plates[static_cast<std::size_t>(plate)]};
  }

  /// The plate of every view that agrees best with `T_L_C`. @return sum of the agreements
  double choose(const Pose& T_L_C, Choice* choice) const {
    choice->assign(views_.size(), {});
    double sum = 0.0;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      double best = 0.0;
      for (int k = 0; k < static_cast<int>(views_[i].plates.size()); ++k) {
        LidarCameraStart::View view;
        view.plate = k;
        const double value = agreement(pair(i, k), T_L_C, params_, &view);
        if (value <= best) continue;
        best = value;
        (*choice)[i] = view;
      }
      sum += best;
    }
    return sum;
  }

  std::vector<PlatePair> pairsOf(const Choice& choice) const {
    std::vector<PlatePair> pairs;
    for (std::size_t i = 0; i < choice.size(); ++i) {
      if (choice[i].plate >= 0) pairs.push_back(pair(i, choice[i].plate));
    }
    return pairs;
  }

  /// Best of the hypotheses that any two views with a plate of each make.
  Choice search() const {
    std::size_t total = 0;
    forEachHypothesis(1, [&](const std::vector<PlatePair>&) { ++total; });
    Choice best(views_.size());
    double best_sum = 0.0;
    forEachHypothesis(1 + total / kMaxHypotheses, [&](const std::vector<PlatePair>& two) {
      Choice choice;
      const double sum = choose(alignPlates(two, true), &choice);
      if (sum <= best_sum) return;
      best_sum = sum;
      best = choice;
    });
    return best;
  }

 private:
  template <typename Visit>
  void forEachHypothesis(std::size_t stride, const Visit& visit) const {
    std::size_t number = 0;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      for (std::size_t j = i + 1; j < views_.size(); ++j) {
        for (int a = 0; a < static_cast<int>(views_[i].plates.size()); ++a) {
          for (int b = 0; b < static_cast<int>(views_[j].plates.size()); ++b) {
            if (number++ % stride == 0) visit({pair(i, a), pair(j, b)});
          }
        }
      }
    }
  }

  const std::vector<BoardView>& views_;
  const LidarCameraInitializerParams& params_;
  std::vector<Pose> T_C_P_;
};

/// RMS tilt of the normals about the direction in which they vary less [rad].
double normalSpread(const std::vector<PlatePair>& pairs) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const PlatePair& pair : pairs) mean += pair.normal_C() / static_cast<double>(pairs.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const PlatePair& pair : pairs) {
    const Eigen::Vector3d d = pair.normal_C() - mean;
    scatter += d * d.transpose() / static_cast<double>(pairs.size());
  }
  // Unit vectors vary in two directions to first order; the third eigenvalue, the smallest, is their curvature.
  return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues()[1]));
}

/// Spread of the result when one view after the other is left out, as the standard deviation of the whole.
Vector6d jackknife(const std::vector<PlatePair>& pairs, const Eigen::Vector2d& size, const PlateFit& fit,
                   const LidarCameraInitializerParams& params) {
  Vector6d sum = Vector6d::Zero(), squares = Vector6d::Zero();
  const auto n = static_cast<double>(pairs.size());
  for (std::size_t out = 0; out < pairs.size(); ++out) {
    std::vector<PlatePair> rest = pairs;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(out));
    const Vector6d difference = refinePlates(rest, size, fit.T_L_C, params).T_L_C.minus(fit.T_L_C);
    sum += difference;
    squares += difference.cwiseAbs2();
  }
  return ((n - 1.0) / n * (squares - sum.cwiseAbs2() / n)).cwiseMax(0.0).cwiseSqrt();
}

}  // namespace

LidarPlate makeLidarPlate(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                          const BoardCandidate& candidate) {
  LidarPlate plate;
  plate.plane_L = candidate.segment.plane_L;
  plate.centre_L = candidate.centre_L;
  for (const int i : candidate.segment.points) {
    plate.points_L.push_back(points_L[static_cast<std::size_t>(i)].cast<double>());
  }
  for (const BoardEdgeCrossing& crossing : candidate.segment.crossings) {
    const auto index = static_cast<std::size_t>(crossing.on_index);
    const Eigen::Vector3d on = scan.points[index].p.cast<double>().normalized();
    const Eigen::Vector3d beyond = crossing.beyond_bearing_L.cast<double>();
    plate.edge_bearings_L.push_back((on + beyond).normalized());
    plate.edge_spacing_rad += (beyond - on).norm() / static_cast<double>(candidate.segment.crossings.size());
  }
  return plate;
}

std::optional<LidarCameraStart> initializeLidarCamera(const std::vector<BoardView>& views, const BoardGeometry& board,
                                                      const LidarCameraInitializerParams& params, std::string* reason) {
  const auto with_plates =
      std::count_if(views.begin(), views.end(), [](const BoardView& v) { return !v.plates.empty(); });
  if (with_plates < kMinViews) {
    return fail(
        reason,
        format("camera and lidar saw the board together %.0f times; at least %.0f different poses of it are needed",
               static_cast<double>(with_plates), kMinViews));
  }
  const PlateConsensus consensus(views, board, params);
  Choice choice = consensus.search();
  std::vector<PlatePair> pairs = consensus.pairsOf(choice);
  if (pairs.size() < kMinViews) {
    return fail(reason,
                format("the flat patches in the lidar sweeps fit the boards in the pictures in %.0f views only; "
                       "%.0f are needed (is the size of the board right in the rig file?)",
                       static_cast<double>(pairs.size()), kMinViews));
  }
  const double spread = normalSpread(pairs);
  if (spread < params.min_normal_spread_rad) {
    return fail(reason,
                format("the board was tilted by %.1f deg only (RMS, in the direction in which it was tilted less; %.1f "
                       "are needed): show it tilted left, right, up and down",
                       spread * 180.0 / M_PI, params.min_normal_spread_rad * 180.0 / M_PI));
  }
  LidarCameraStart start;
  start.closed_form_T_lidar_camera = alignPlates(pairs, false);
  PlateFit fit = refinePlates(pairs, plateSize(board), start.closed_form_T_lidar_camera, params);
  // The better transform may let views in that the hypothesis left out, or the other way round.
  consensus.choose(fit.T_L_C, &choice);
  pairs = consensus.pairsOf(choice);
  if (pairs.size() < kMinViews) return fail(reason, "the views of the board contradict each other");
  fit = refinePlates(pairs, plateSize(board), fit.T_L_C, params);
  consensus.choose(fit.T_L_C, &start.views);
  start.T_lidar_camera = fit.T_L_C;
  start.range_bias_m = fit.range_bias_m;
  start.plane_rms_m = fit.plane_rms_m;
  start.edge_rms_m = fit.edge_rms_m;
  start.used_views = static_cast<int>(pairs.size());
  start.sigma = jackknife(pairs, plateSize(board), fit, params);
  return start;
}

}  // namespace cocalib
