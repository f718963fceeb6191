#include "cocalib/lidar/board_segmenter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "cocalib/lidar/board_rectangle.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// A sweep of the simulated room, deskewed with the true motion to its begin.
struct Sweep {
  LidarScan scan;
  std::vector<std::int16_t> surface;
  std::vector<Eigen::Vector3f> points_L;
  std::vector<Pose> T_L_S;  ///< pose of the sensor at each point's time, in the sweep's first frame
  Pose T_L_B;
};

class Room {
 public:
  explicit Room(const sim::Scenario& scenario) : scenario_(scenario), scene_(scenario), trajectory_(scenario) {}

  Sweep sweep(int k) const {
    sim::SimulatedScan simulated = sim::simulateScan(scenario_, scene_, trajectory_, k);
    Sweep sweep;
    sweep.scan = std::move(simulated.scan);
    sweep.surface = std::move(simulated.surface);
    const Pose T_L_W = T_W_L(sweep.scan.stamp).inverse();
    for (const LidarPoint& point : sweep.scan.points) {
      sweep.T_L_S.push_back(T_L_W * T_W_L(sweep.scan.stamp + toNs(point.offset_s)));
      sweep.points_L.push_back((sweep.T_L_S.back() * point.p.cast<double>()).cast<float>());
    }
    sweep.T_L_B = T_L_W * scene_.T_W_B();
    return sweep;
  }
  int boardIndex() const { return scene_.boardIndex(); }
  BoardGeometry board() const { return scenario_.board.geometry(); }

 private:
  Pose T_W_L(TimeNs stamp) const {
    return trajectory_.T_W_I(trajectory_.timeOf(stamp)) * scenario_.lidar.T_imu_lidar();
  }

  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
};

constexpr double kNoise = 0.03;

/// Prediction that is wrong by about `sigma_m` and `sigma_rad`, differently for every `k`.
Pose disturbed(const Pose& T, int k, double sigma_m, double sigma_rad) {
  Vector6d delta;
  for (int i = 0; i < 6; ++i) delta[i] = std::sin(1.0 + 7.3 * k + 2.1 * i) * (i < 3 ? sigma_m : sigma_rad);
  // Turned about the board, not about the lidar, which stands metres away.
  return {(expSo3(delta.tail<3>()) * T.q).normalized(), T.t + delta.head<3>()};
}

std::optional<BoardSegment> segment(const Sweep& sweep, const BoardGeometry& board, int k = 0) {
  return segmentBoard(sweep.scan, sweep.points_L, disturbed(sweep.T_L_B, k, 0.05, 0.04), board, kNoise, 0.05, 0.04);
}

/// Plate coordinates from its middle of the place where a beam meets the board's plane.
Eigen::Vector2d hitOnPlate(const Sweep& sweep, const BoardGeometry& board, const Pose& T_L_S,
                           const Eigen::Vector3d& bearing_S) {
  const Pose T_B_S = sweep.T_L_B.inverse() * T_L_S;
  const Eigen::Vector3d ray = T_B_S.q * bearing_S;
  const Eigen::Vector3d hit = T_B_S.t - ray * (T_B_S.t.z() / ray.z());
  return (hit - plateCentre(board)).head<2>();
}

TEST(BoardSegmenter, FindsTheBoardsPointsInMotion) {
  const Room room{sim::Scenario{}};
  int found = 0, tried = 0;
  std::size_t right = 0, all = 0, on_board = 0;
  for (int k = 20; k < 320; k += 20) {
    const Sweep sweep = room.sweep(k);
    const auto truth = std::count(sweep.surface.begin(), sweep.surface.end(), room.boardIndex());
    if (truth < 60) continue;  // turned away from it
    ++tried;
    const auto segment_k = segment(sweep, room.board(), k);
    if (!segment_k) continue;
    ++found;
    all += segment_k->points.size();
    on_board += static_cast<std::size_t>(truth);
    for (const int i : segment_k->points) right += sweep.surface[static_cast<std::size_t>(i)] == room.boardIndex();
    const Eigen::Vector3d normal = sweep.T_L_B.q * Eigen::Vector3d::UnitZ();
    // 3 cm of noise and 400 points over a metre: 0.4 deg on average. A strip of three rings, where the board leaves the
    // field of view, tells the tilt ten times worse.
    const bool whole = truth > 300;
    const double cosine = std::abs(segment_k->plane_L.normal.dot(normal));
    EXPECT_LT(std::acos(std::min(1.0, cosine)), whole ? 0.03 : 0.2) << "sweep " << k;
    const double distance = segment_k->plane_L.distance(sweep.T_L_B * plateCentre(room.board()));
    EXPECT_LT(std::abs(distance), whole ? 0.012 : 0.05) << "sweep " << k;
  }
  ASSERT_GE(tried, 8);
  EXPECT_GE(found, tried - 1);
  EXPECT_GT(static_cast<double>(right), 0.998 * static_cast<double>(all));  // the rim is left out on purpose
  EXPECT_GT(static_cast<double>(right), 0.75 * static_cast<double>(on_board));
}

TEST(BoardSegmenter, CrossingsEncloseTheOutline) {
  const Room room{sim::Scenario{}};
  const Eigen::Vector2d half = 0.5 * plateSize(room.board());
  const plate::Rectangle plate{Eigen::Vector2d::Zero(), 0.0, half};
  int crossings = 0, enclosing = 0;
  for (int k = 20; k < 320; k += 20) {
    const Sweep sweep = room.sweep(k);
    const auto segment_k = segment(sweep, room.board(), k);
    if (!segment_k) continue;
    for (const BoardEdgeCrossing& crossing : segment_k->crossings) {
      const auto on = static_cast<std::size_t>(crossing.on_index);
      const Eigen::Vector3d bearing = sweep.scan.points[on].p.cast<double>();
      const double inside = plate.signedDistance(hitOnPlate(sweep, room.board(), sweep.T_L_S[on], bearing));
      // One step later the sensor has hardly moved: 55 us at 2 m/s are 0.1 mm.
      const double outside = plate.signedDistance(
          hitOnPlate(sweep, room.board(), sweep.T_L_S[on], crossing.beyond_bearing_L.cast<double>()));
      EXPECT_NEAR(crossing.beyond_bearing_L.norm(), 1.0, 1e-5);
      EXPECT_NEAR(crossing.beyond_offset_s, sweep.scan.points[on].offset_s, 2e-3);
      ++crossings;
      enclosing += inside < 1e-3 && outside > -1e-3;
    }
  }
  ASSERT_GT(crossings, 80);
  // A return may be lost to the gate by noise (3 of 1000); then the crossing is one beam off.
  EXPECT_GT(enclosing, 0.95 * crossings);
}

TEST(BoardSegmenter, RefusesBoardsOfAnotherSize) {
  sim::Scenario scenario;
  scenario.motion = sim::Motion::kStatic;
  const Room room(scenario);
  const Sweep sweep = room.sweep(0);
  ASSERT_TRUE(segment(sweep, room.board()));
  for (const double factor : {0.6, 0.75, 1.3, 1.6}) {
    BoardGeometry other = room.board();
    other.square_m *= factor;
    other.width_m = factor * *room.board().width_m;
    other.height_m = factor * *room.board().height_m;
    const Pose T_P = sweep.T_L_B * Pose{Eigen::Quaterniond::Identity(), plateCentre(room.board())};
    const Pose T_L_B = T_P * Pose{Eigen::Quaterniond::Identity(), -plateCentre(other)};
    EXPECT_FALSE(segmentBoard(sweep.scan, sweep.points_L, T_L_B, other, kNoise, 0.03, 0.03)) << "factor " << factor;
    for (const auto& candidate : findBoardCandidates(sweep.scan, sweep.points_L, other, kNoise)) {
      EXPECT_GT((candidate.centre_L - T_P.t).norm(), 0.3) << "factor " << factor;
    }
  }
}

TEST(BoardSegmenter, RefusesAWall) {
  sim::Scenario scenario;
  scenario.motion = sim::Motion::kStatic;
  scenario.board.present = false;
  const Room room(scenario);
  const Sweep sweep = room.sweep(0);
  // A place on the wall ahead: the surface with most returns in front of the lidar.
  std::vector<int> hits(64, 0);
  for (std::size_t i = 0; i < sweep.surface.size(); ++i) {
    if (sweep.points_L[i].x() > 1.0F && std::abs(sweep.points_L[i].y()) < 0.5F)
      ++hits[static_cast<std::size_t>(sweep.surface[i])];
  }
  const auto wall = static_cast<std::int16_t>(std::max_element(hits.begin(), hits.end()) - hits.begin());
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < sweep.surface.size(); ++i) {
    const Eigen::Vector3d p = sweep.points_L[i].cast<double>();
    if (sweep.surface[i] == wall && std::abs(p.y()) < 0.5 && p.x() > 1.0) points.push_back(p);
  }
  ASSERT_GT(points.size(), 50U);
  const Eigen::Vector3d middle = points[points.size() / 2];
  const Eigen::Vector3d normal = (points.front() - middle).cross(points.back() - middle).normalized();
  const Eigen::Quaterniond towards = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal);
  const Pose T_L_B = Pose{towards, middle} * Pose{Eigen::Quaterniond::Identity(), -plateCentre(room.board())};
  EXPECT_FALSE(segmentBoard(sweep.scan, sweep.points_L, T_L_B, room.board(), kNoise, 0.05, 0.05));
}

TEST(BoardSegmenter, NothingStandsThere) {
  sim::Scenario scenario;
  scenario.motion = sim::Motion::kStatic;
  const Room room(scenario);
  const Sweep sweep = room.sweep(0);
  const Pose away{sweep.T_L_B.q, sweep.T_L_B.t + Eigen::Vector3d(0.0, 0.9, 0.0)};
  EXPECT_FALSE(segmentBoard(sweep.scan, sweep.points_L, away, room.board(), kNoise, 0.05, 0.04));
  EXPECT_FALSE(segmentBoard(LidarScan{}, {}, sweep.T_L_B, room.board(), kNoise, 0.05, 0.04));
  EXPECT_TRUE(findBoardCandidates(LidarScan{}, {}, room.board(), kNoise).empty());
}

/// Plates and nothing else: a grid of beams from the origin that meet a plate, the background or nothing.
struct LonelyPlates {
  LidarScan scan;
  std::vector<Eigen::Vector3f> points_L;

  /// @param middles  of plates that face the lidar, 1 m wide and 0.8 m high
  /// @param background_m  range of what stands behind them all; nothing: open air but for the sweep's first and last
  /// beam
  explicit LonelyPlates(const std::vector<Eigen::Vector3d>& middles, std::optional<double> background_m = {}) {
    for (int ring = 0; ring < 16; ++ring) {
      for (int step = 0; step < 600; ++step) {
        const double azimuth = (step - 300) * 0.2 * M_PI / 180.0, elevation = (2.0 * ring - 15.0) * M_PI / 180.0;
        const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                                  std::sin(elevation));
        std::optional<double> range = background_m;
        if (step == 0 || step == 599) range = 20.0;
        for (const Eigen::Vector3d& middle : middles) {
          const Eigen::Vector3d p = ray * (middle.x() / ray.x());
          if (std::abs(p.y() - middle.y()) < 0.5 && std::abs(p.z() - middle.z()) < 0.4) range = p.norm();
        }
        if (!range) continue;
        const double noise = 0.01 * std::sin(12.9 * ring + 78.2 * step);
        scan.points.push_back({((*range + noise) * ray).cast<float>(), static_cast<float>(step * 5.5e-5),
                               static_cast<std::int16_t>(ring)});
        points_L.push_back(scan.points.back().p);
      }
    }
  }
};

BoardGeometry lonelyBoard() {
  BoardGeometry board;
  board.cols = 9;
  board.rows = 7;
  board.square_m = 0.1;  // 1.0 m x 0.8 m follow from it
  return board;
}

Pose facingLidar(const Eigen::Vector3d& middle) {
  Eigen::Matrix3d R;
  R.col(0) = -Eigen::Vector3d::UnitY();
  R.col(1) = -Eigen::Vector3d::UnitZ();
  R.col(2) = Eigen::Vector3d::UnitX();
  return Pose{Eigen::Quaterniond(R), middle} * Pose{Eigen::Quaterniond::Identity(), -plateCentre(lonelyBoard())};
}

TEST(BoardSegmenter, MissingReturnsAreBeyondToo) {
  const Eigen::Vector3d middle(3.0, 0.2, 0.0);
  const LonelyPlates plates({middle});
  const auto segment_1 =
      segmentBoard(plates.scan, plates.points_L, facingLidar(middle), lonelyBoard(), 0.01, 0.03, 0.03);
  ASSERT_TRUE(segment_1);
  EXPECT_GE(segment_1->crossings.size(), 12U);  // 7 or 8 rings of 0.1 m spacing pass it
  const double step = 0.2 * M_PI / 180.0;
  for (const BoardEdgeCrossing& crossing : segment_1->crossings) {
    const Eigen::Vector3f on = plates.points_L[static_cast<std::size_t>(crossing.on_index)];
    const double on_azimuth = std::atan2(on.y(), on.x());
    const double azimuth = std::atan2(crossing.beyond_bearing_L.y(), crossing.beyond_bearing_L.x());
    EXPECT_NEAR(std::abs(azimuth - on_azimuth), step, 0.02 * step);
    EXPECT_GT(std::abs(3.0 * std::tan(azimuth) - middle.y()), 0.5);
  }
}

TEST(BoardSegmenter, RefusesToChooseBetweenTwo) {
  const Eigen::Vector3d one(3.0, 0.65, 0.0), other(3.0, -0.65, 0.0);
  const LonelyPlates plates({one, other}, 20.0);
  const Pose between = facingLidar({3.0, 0.0, 0.0});
  EXPECT_FALSE(segmentBoard(plates.scan, plates.points_L, between, lonelyBoard(), 0.01, 0.25, 0.05));
  EXPECT_TRUE(segmentBoard(plates.scan, plates.points_L, facingLidar(one), lonelyBoard(), 0.01, 0.03, 0.03));
  EXPECT_EQ(findBoardCandidates(plates.scan, plates.points_L, lonelyBoard(), 0.01).size(), 2U);
}

TEST(BoardSegmenter, FindsTheBoardWithoutPrediction) {
  for (const double roll : {0.0, 0.4, 0.8}) {
    sim::Scenario scenario;
    scenario.motion = sim::Motion::kStatic;
    scenario.board.tilt_rpy = {roll, 0.3, 0.2};
    const Room room(scenario);
    const Sweep sweep = room.sweep(0);
    const Eigen::Vector3d centre = sweep.T_L_B * plateCentre(room.board());
    const auto candidates = findBoardCandidates(sweep.scan, sweep.points_L, room.board(), kNoise);
    const auto board = std::find_if(candidates.begin(), candidates.end(), [&](const BoardCandidate& candidate) {
      return (candidate.centre_L - centre).norm() < 0.06;  // rings stand 0.1 m apart there
    });
    ASSERT_NE(board, candidates.end()) << "roll " << roll;
    EXPECT_LT(std::acos(std::abs(board->normal_L.dot(sweep.T_L_B.q * Eigen::Vector3d::UnitZ()))), 0.03);
    EXPECT_GT(board->normal_L.dot(board->centre_L), 0.0);
    EXPECT_NEAR(board->extent_m.x(), 1.0, 0.1);
    EXPECT_NEAR(board->extent_m.y(), 0.8, 0.1);
    EXPECT_GT(board->score, 0.6);
  }
}

}  // namespace
}  // namespace cocalib
