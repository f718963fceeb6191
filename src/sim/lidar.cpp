#include "cocalib/sim/lidar.h"

#include <cmath>
#include <limits>

#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

constexpr double kPi = 3.141592653589793;
constexpr double kDegree = kPi / 180.0;

// A spinning lidar: `rings` elevations equally spaced, `columns` firings a turn; within a firing laser i of the firing
// order follows laser i-1 after `laser_delay_s`.
struct SpinningModel {
  int rings, columns;
  double lowest_rad, highest_rad, laser_delay_s;
  bool interleaved;  // fired in the order 0, n/2, 1, n/2+1, ... as in the VLP-16; otherwise from the lowest up
};

SpinningModel spinningModel(LidarModel model) {
  switch (model) {
    case LidarModel::kOs1_32:
      return {32, 1024, -22.5 * kDegree, 22.5 * kDegree, 0.0, false};
    case LidarModel::kOs1_64:
      return {64, 1024, -22.5 * kDegree, 22.5 * kDegree, 0.0, false};
    case LidarModel::kOs1_128:
      return {128, 1024, -22.5 * kDegree, 22.5 * kDegree, 0.0, false};
    case LidarModel::kXt32:
      return {32, 2000, -16.0 * kDegree, 15.0 * kDegree, 1.512e-6, false};
    case LidarModel::kRs32:
      return {32, 1800, -25.0 * kDegree, 15.0 * kDegree, 1.4e-6, false};
    default:
      return {16, 1800, -15.0 * kDegree, 15.0 * kDegree, 2.304e-6, true};
  }
}

std::vector<Beam> spinningSweep(const Scenario::Lidar& lidar) {
  const SpinningModel model = spinningModel(lidar.model);
  const double column_s = 1.0 / (lidar.rate_hz * model.columns);
  std::vector<Beam> beams;
  beams.reserve(static_cast<std::size_t>(model.columns) * model.rings);
  for (int column = 0; column < model.columns; ++column) {
    for (int i = 0; i < model.rings; ++i) {
      Beam beam;
      beam.ring = !model.interleaved ? i : (i % 2 == 0 ? i / 2 : model.rings / 2 + i / 2);
      beam.offset_s = column * column_s + i * model.laser_delay_s;
      // The head turns on between the lasers of one firing. It begins at the rear and turns clockwise.
      const double azimuth = kPi - 2.0 * kPi * lidar.rate_hz * beam.offset_s;
      const double elevation =
          model.lowest_rad + (model.highest_rad - model.lowest_rad) * beam.ring / (model.rings - 1.0);
      beam.direction = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                        std::sin(elevation)};
      beams.push_back(beam);
    }
  }
  return beams;
}

// Two wedge prisms that turn against each other at incommensurable speeds draw a rosette that does not repeat; six
// lines side by side. Speeds and opening are those of a Livox Avia.
constexpr int kLivoxLines = 6;
std::vector<Beam> livoxSweep(const Scenario::Lidar& lidar, int k) {
  constexpr double kPointRate_hz = 40000.0;  // per line
  constexpr double kFirst_hz = 7294.0 / 60.0, kSecond_hz = -4664.0 / 60.0;
  constexpr double kHalfOpening_rad = 35.0 * kDegree, kLineSpacing_rad = 0.6 * kDegree;
  const int shots = static_cast<int>(std::lround(kPointRate_hz / lidar.rate_hz));
  std::vector<Beam> beams;
  beams.reserve(static_cast<std::size_t>(shots) * kLivoxLines);
  for (int shot = 0; shot < shots; ++shot) {
    for (int line = 0; line < kLivoxLines; ++line) {
      Beam beam;
      beam.ring = line;
      beam.offset_s = (shot + static_cast<double>(line) / kLivoxLines) / kPointRate_hz;
      const double t = k / lidar.rate_hz + beam.offset_s;
      const double a = 2.0 * kPi * kFirst_hz * t, b = 2.0 * kPi * kSecond_hz * t;
      const double y = 0.5 * kHalfOpening_rad * (std::cos(a) + std::cos(b));
      const double z =
          0.5 * kHalfOpening_rad * (std::sin(a) + std::sin(b)) + (line - 0.5 * (kLivoxLines - 1)) * kLineSpacing_rad;
      beam.direction = {std::cos(z) * std::cos(y), std::cos(z) * std::sin(y), std::sin(z)};
      beams.push_back(beam);
    }
  }
  return beams;
}

}  // namespace

std::vector<Beam> sweepBeams(const Scenario& scenario, int k) {
  if (scenario.lidar.model == LidarModel::kLivox) return livoxSweep(scenario.lidar, k);
  return spinningSweep(scenario.lidar);
}

int ringCount(LidarModel model) { return model == LidarModel::kLivox ? kLivoxLines : spinningModel(model).rings; }

int scanCount(const Scenario& scenario) {
  return static_cast<int>(std::floor(scenario.duration_s * scenario.lidar.rate_hz + 1e-9));
}

SimulatedScan simulateScan(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int k) {
  const Scenario::Lidar& lidar = scenario.lidar;
  const double begin_s = k / lidar.rate_hz;
  const double max_incidence_cosine = std::cos(lidar.max_incidence_rad);
  const Pose T_I_L = lidar.T_imu_lidar();
  Random random(scenario.seed, Random::Stream::kRange, static_cast<std::uint64_t>(k));
  const std::vector<Beam> beams = sweepBeams(scenario, k);

  SimulatedScan result;
  result.scan.stamp = trajectory.stampOf(begin_s) - toNs(lidar.time_offset_s);
  result.scan.points.reserve(beams.size());
  result.surface.reserve(beams.size());
  double pose_time = -1.0;
  Pose T_W_L;
  for (const Beam& beam : beams) {
    const double t = begin_s + beam.offset_s;
    if (t != pose_time) {
      T_W_L = trajectory.T_W_I(t) * T_I_L;
      pose_time = t;
    }
    const Eigen::Vector3d direction_W = T_W_L.q * beam.direction;
    const std::optional<Scene::Hit> hit = scene.raycast(T_W_L.t, direction_W);
    const double noise = lidar.range_noise_m * random.normal();  // drawn for each beam: misses shift nothing
    const bool returned = hit && hit->range >= lidar.min_range_m && hit->range <= lidar.max_range_m &&
                          std::abs(scene.rectangles()[hit->index].normal.dot(direction_W)) >= max_incidence_cosine;
    if (!returned && !lidar.keep_no_return) continue;
    LidarPoint point;
    point.offset_s = static_cast<float>(beam.offset_s);
    point.ring = static_cast<std::int16_t>(beam.ring);
    point.p.setConstant(std::numeric_limits<float>::quiet_NaN());
    if (returned) point.p = (beam.direction * (hit->range + noise)).cast<float>();
    result.scan.points.push_back(point);
    result.surface.push_back(static_cast<std::int16_t>(returned ? hit->index : -1));
  }
  return result;
}

}  // namespace cocalib::sim
