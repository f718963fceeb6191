#include "cocalib/lidar/lidar_odometry.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "cocalib/lidar/elastic_registration.h"
#include "cocalib/lidar/planar_voxel_map.h"

namespace cocalib {
namespace {

// Hand-held or flying sensors: what velocity and acceleration change between sweeps, 1 sigma.
constexpr double kAngularAcceleration = 4.0;   // rad/s^2
constexpr double kLinearAcceleration = 4.0;    // m/s^2
constexpr double kAngularVelocity = 2.0;       // rad/s; before any motion is known
constexpr double kLinearVelocity = 2.0;        // m/s
constexpr double kAngularVelocityStep = 0.15;  // rad/s between the end of one sweep and the begin of the next
constexpr double kLinearVelocityStep = 0.25;   // m/s
constexpr double kAngularStep = 0.003;         // rad; error of the last sweep's end pose
constexpr double kLinearStep = 0.006;          // m

constexpr double kDeskewError = 0.015;      // m; what the motion model leaves in a sweep
constexpr double kFirstGate = 0.6;          // m
constexpr double kUnknownMotionGate = 1.5;  // m; the first two sweeps
constexpr double kLastGateSigmas = 3.5;
constexpr double kThicknessSigmas = 2.0;  // of a local plane
constexpr int kBootstrapRounds = 5;
constexpr int kInsertFactor = 3;  // points that enter the map / points used for registration

constexpr int kMinPoints = 100;
constexpr double kMinOverlap = 0.5;
constexpr double kMinOverlapToInsert = 0.3;
constexpr double kMaxRotationSigma = 0.005;  // rad
constexpr double kMaxPositionSigma = 0.03;   // m; worse directions count as open
constexpr int kMaxLostSweeps = 5;            // then the map starts anew

Vector6d tangent(double translation, double rotation) {
  Vector6d v;
  v << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return v;
}

/// At most `count` points, one from each stretch of the sweep's order: even over time, and at random within the stretch
/// so that no multiple of the ring count favours a ring.
std::vector<SweepPoint> sample(const LidarScan& scan, int count, double duration_s) {
  const std::size_t total = scan.points.size();
  const std::size_t taken = std::min<std::size_t>(total, static_cast<std::size_t>(count));
  std::vector<SweepPoint> points;
  points.reserve(taken);
  std::minstd_rand random(1);  // the same draw for every sweep: the result depends on the points only
  for (std::size_t i = 0; i < taken; ++i) {
    const std::size_t first = i * total / taken;
    const std::size_t width = (i + 1) * total / taken - first;
    const LidarPoint& point = scan.points[first + random() % width];
    if (!point.p.allFinite()) continue;
    points.push_back({point.p.cast<double>(), duration_s > 0.0 ? point.offset_s / duration_s : 0.0});
  }
  return points;
}

Eigen::Matrix3d seenDirections(const Eigen::Matrix3d& position_covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(position_covariance);
  Eigen::Matrix3d projection = Eigen::Matrix3d::Zero();
  for (int i = 0; i < 3; ++i) {
    if (eigen.eigenvalues()[i] > kMaxPositionSigma * kMaxPositionSigma) continue;
    projection += eigen.eigenvectors().col(i) * eigen.eigenvectors().col(i).transpose();
  }
  return projection;
}

double durationOf(const LidarScan& scan) {
  float last = 0.0F;
  for (const LidarPoint& point : scan.points) last = std::max(last, point.offset_s);
  return last;
}

}  // namespace

struct LidarOdometry::Impl {
  explicit Impl(const Params& p)
      : params(p), sigma_m(std::hypot(p.range_noise_m, kDeskewError)), map(p.voxel_m, kThicknessSigmas * sigma_m) {}

  /// One sweep and its motion.
  struct Sweep {
    TimeNs begin = 0;
    double duration_s = 0.0;
    std::vector<SweepPoint> points;      ///< for registration
    std::vector<SweepPoint> map_points;  ///< for the map
    SweepMotion motion;
    TimeNs end() const { return begin + toNs(duration_s); }
  };

  Sweep prepare(const LidarScan& scan) const;
  Result first(const Sweep& sweep);
  Result second(Sweep sweep);
  Result next(Sweep sweep);
  MotionPrior predict(const Sweep& sweep, SweepMotion* start) const;
  void insert(const Sweep& sweep);
  void accept(Sweep sweep, const Vector6d& velocity);
  Result resultOf(const Sweep& sweep, const ElasticRegistrationResult& registration) const;

  Params params;
  double sigma_m;
  PlanarVoxelMap map;
  int sweeps = 0;                        ///< registered so far; 1: only the first sweep, its motion unknown
  int lost = 0;                          ///< sweeps in a row that did not fit the map
  Sweep last;                            ///< the newest sweep
  Vector6d velocity = Vector6d::Zero();  ///< at its end, per second
};

LidarOdometry::Impl::Sweep LidarOdometry::Impl::prepare(const LidarScan& scan) const {
  Sweep sweep;
  sweep.begin = scan.stamp;
  sweep.duration_s = durationOf(scan);
  sweep.points = sample(scan, params.max_points, sweep.duration_s);
  sweep.map_points = sample(scan, kInsertFactor * params.max_points, sweep.duration_s);
  return sweep;
}

void LidarOdometry::Impl::insert(const Sweep& sweep) {
  const SampledMotion path(sweep.motion);
  for (const SweepPoint& point : sweep.map_points) map.add(path.apply(point));
  map.refresh();
}

LidarOdometry::Result LidarOdometry::Impl::resultOf(const Sweep& sweep,
                                                    const ElasticRegistrationResult& registration) const {
  Result result;
  result.begin = sweep.begin;
  result.end = sweep.end();
  result.T_M_L_begin = sweep.motion.begin;
  result.T_M_L_end = sweep.motion.end;
  result.bow = sweep.motion.bow;
  result.rms_m = registration.rms_m;
  result.overlap = registration.overlap;
  result.registered = registration.overlap >= kMinOverlap;
  result.good = result.registered && registration.rotation_sigma <= kMaxRotationSigma;
  result.seen_directions = seenDirections(registration.translation_covariance);
  return result;
}

LidarOdometry::Result LidarOdometry::Impl::first(const Sweep& sweep) {
  insert(sweep);
  last = sweep;
  velocity.setZero();
  sweeps = 1;
  return resultOf(sweep, {});
}

/// The first sweep's deskew is unknown, so the map that it makes is warped; the second sweep, warped alike, still tells
/// the velocity, which straightens the first, and so on.
LidarOdometry::Result LidarOdometry::Impl::second(Sweep sweep) {
  const double period_s = std::max(toSeconds(sweep.begin - last.begin), 1e-3);
  const double share = last.duration_s / period_s;  // of a period that the points span
  ElasticRegistrationOptions options{params.max_iterations, sigma_m, kUnknownMotionGate, kLastGateSigmas * sigma_m};
  ElasticRegistrationResult registration;
  Vector6d step = Vector6d::Zero();  // change of pose over one period
  for (int round = 0; round < kBootstrapRounds; ++round) {
    last.motion.end = last.motion.begin.plus(share * step);
    map.clear();
    insert(last);
    SweepMotion start;
    start.begin = last.motion.begin.plus(step);
    start.end = start.begin.plus(share * step);
    MotionPrior prior;
    prior.begin = start.begin;
    prior.begin_sigma = tangent(kLinearVelocity, kAngularVelocity) * period_s;
    prior.begin_velocity = share * step;
    prior.begin_velocity_sigma = tangent(kLinearAcceleration, kAngularAcceleration) * period_s * period_s;
    prior.bow_sigma = tangent(kLinearAcceleration, kAngularAcceleration) * period_s * period_s / 8.0;
    registration = registerElastic(map, sweep.points, start, prior, options);
    step = registration.motion.begin.minus(last.motion.begin);
    options.first_gate_m = kFirstGate;
  }
  sweep.motion = registration.motion;
  const Result result = resultOf(sweep, registration);
  if (!result.registered) {
    map.clear();
    first(sweep);
    return resultOf(sweep, {});
  }
  insert(sweep);
  accept(std::move(sweep), step / period_s);
  return result;
}

/// @param fallback velocity per second for sweeps without duration
void LidarOdometry::Impl::accept(Sweep sweep, const Vector6d& fallback) {
  velocity = sweep.duration_s > 1e-3 ? Vector6d(sweep.motion.endVelocity() / sweep.duration_s) : fallback;
  last = std::move(sweep);
  ++sweeps;
}

MotionPrior LidarOdometry::Impl::predict(const Sweep& sweep, SweepMotion* start) const {
  const double gap_s = toSeconds(sweep.begin - last.end());
  const double span_s = std::abs(gap_s);
  const double T = sweep.duration_s;
  MotionPrior prior;
  prior.begin = last.motion.end.plus(gap_s * velocity);
  prior.begin_sigma = tangent(kLinearStep, kAngularStep) + tangent(kLinearVelocityStep, kAngularVelocityStep) * span_s +
                      0.5 * span_s * span_s * tangent(kLinearAcceleration, kAngularAcceleration);
  prior.begin_velocity = T * velocity;
  // Also for sweeps without duration, where all points lie at the begin, the rest must stay determined.
  const double T_floor = std::max(T, 1e-3);
  prior.begin_velocity_sigma = T_floor * (tangent(kLinearVelocityStep, kAngularVelocityStep) +
                                          span_s * tangent(kLinearAcceleration, kAngularAcceleration));
  prior.bow_sigma = T_floor * T_floor / 8.0 * tangent(kLinearAcceleration, kAngularAcceleration);
  start->begin = prior.begin;
  start->end = prior.begin.plus(T * velocity);
  return prior;
}

LidarOdometry::Result LidarOdometry::Impl::next(Sweep sweep) {
  SweepMotion start;
  const MotionPrior prior = predict(sweep, &start);
  const ElasticRegistrationOptions options{params.max_iterations, sigma_m, kFirstGate, kLastGateSigmas * sigma_m};
  const ElasticRegistrationResult registration = registerElastic(map, sweep.points, start, prior, options);
  sweep.motion = registration.motion;
  const Result result = resultOf(sweep, registration);
  lost = result.registered ? 0 : lost + 1;
  if (lost > kMaxLostSweeps) {
    map.clear();
    lost = 0;
    sweeps = 0;
    first(sweep);
    return result;
  }
  if (result.overlap >= kMinOverlapToInsert) insert(sweep);
  const double period_s = std::max(toSeconds(sweep.begin - last.begin), 1e-3);
  const Vector6d mean_velocity = sweep.motion.begin.minus(last.motion.begin) / period_s;
  accept(std::move(sweep), mean_velocity);
  return result;
}

LidarOdometry::LidarOdometry(const Params& params) {
  if (!(params.voxel_m > 0.0) || params.max_points <= 0 || params.max_iterations <= 0 ||
      !(params.range_noise_m > 0.0)) {
    throw std::invalid_argument(
        "LidarOdometry: voxel_m, max_points, max_iterations and range_noise_m must be positive");
  }
  impl_ = std::make_unique<Impl>(params);
}

LidarOdometry::~LidarOdometry() = default;

Pose LidarOdometry::Result::at(double fraction) const { return SweepMotion{T_M_L_begin, T_M_L_end, bow}.at(fraction); }

LidarOdometry::Result LidarOdometry::addScan(const LidarScan& scan) {
  Impl::Sweep sweep = impl_->prepare(scan);
  if (static_cast<int>(sweep.points.size()) < kMinPoints) {
    if (impl_->sweeps > 0) impl_->predict(sweep, &sweep.motion);
    return impl_->resultOf(sweep, {});
  }
  if (impl_->sweeps == 0) return impl_->first(sweep);
  if (impl_->sweeps == 1) return impl_->second(std::move(sweep));
  return impl_->next(std::move(sweep));
}

void LidarOdometry::reset() { impl_ = std::make_unique<Impl>(impl_->params); }

}  // namespace cocalib
