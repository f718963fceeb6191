#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/attitude_fit.h"
#include "cocalib/initialization/robust.h"
#include "cocalib/initialization/shared_information.h"

namespace cocalib {
namespace {

constexpr double kGravity = 9.80665;        // standard; on Earth it differs by less than 0.03
constexpr double kGravityTolerance = 0.1;   // [m/s^2] beyond three sigma: 9.7 to 9.9
constexpr double kVelocityPrior = 10.0;     // [m/s], keeps a chunk of two poses finite
constexpr double kPositionPrior_m = 100.0;  // keeps a direction finite that no pose sees
constexpr double kCauchySigmas = 2.5;
constexpr int kReweightings = 8;
constexpr std::size_t kFewestPoses = 15;
constexpr double kShortest_s = 3.0;
constexpr double kMostResiduals = 5.0;        // times the stated position noise
constexpr double kFarthestUncovered_s = 0.5;  // that states may lie outside the IMU's data

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix69 = Eigen::Matrix<double, 6, 9>;

std::string text(const char* format, double value) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, value);
  return buffer.data();
}

/// One sensor position as a linear function of its chunk's start (position, velocity) and the shared unknowns,
/// p_M_S - predicted = J_local y + J_shared x, in the directions that the sensor sees.
struct PositionEquation {
  std::size_t chunk;
  Eigen::Vector3d known;
  Eigen::Matrix<double, 3, 6> J_local;
  Eigen::Matrix<double, 3, 9> J_shared;
};

/// One chunk's normal equations with its start's position and velocity eliminated.
struct ChunkEquations {
  Matrix6 H_local = Matrix6::Zero();
  Matrix69 H_cross = Matrix69::Zero();
  Vector6 b_local = Vector6::Zero();
  SharedInformation shared;

  SharedInformation reduced() const {
    const Eigen::LDLT<Matrix6> ldlt(H_local);
    SharedInformation result = shared;
    result.H -= H_cross.transpose() * ldlt.solve(H_cross);
    result.b -= H_cross.transpose() * ldlt.solve(b_local);
    return result;
  }
  Vector6 solveLocal(const Vector9d& x) const { return H_local.ldlt().solve(b_local - H_cross * x); }
};

/// The linear problem for one way of cutting the data into chunks.
class PoseAlignment {
 public:
  PoseAlignment(AttitudeFit attitude, const std::vector<SensorPose>& poses, const AlignmentParams& params)
      : attitude_(std::move(attitude)), params_(params), prior_(priorInformation(params)) {
    for (std::size_t c = 0; c < attitude_.chunks.size(); ++c) {
      const Chunk& chunk = attitude_.chunks[c];
      for (std::size_t i = chunk.begin; i < chunk.end; ++i) equations_.push_back(equation(c, poses[i]));
    }
  }

  void solve() {
    std::vector<double> weights(equations_.size(), 1.0);
    for (int iteration = 0; iteration < kReweightings; ++iteration) {
      accumulate(weights);
      SharedInformation all = prior_;
      for (const ChunkEquations& chunk : chunks_) all += chunk.reduced();
      free_ = solveFree(all);
      solution_ = solveWithGravity(all, kGravity);
      starts_.clear();
      for (const ChunkEquations& chunk : chunks_) starts_.push_back(chunk.solveLocal(solution_.x));
      reweight(weights);
    }
    std::vector<SharedInformation> parts;
    for (const ChunkEquations& chunk : chunks_) parts.push_back(chunk.reduced());
    lever_covariance_ = honestLeverCovariance(parts, prior_, kGravity);
  }

  const SharedSolution& freeSolution() const { return free_; }
  const Eigen::Matrix3d& leverCovariance() const { return lever_covariance_; }
  double residualSigma() const { return sigma_; }
  double worstLeverSigma() const { return std::sqrt(lever_covariance_.diagonal().maxCoeff()); }
  /// Smaller is better: the worst axis, or, where an axis may stay open, all of them together.
  double uncertainty() const { return params_.isOpen() ? lever_covariance_.determinant() : worstLeverSigma(); }

  Alignment result(const std::vector<SensorPose>& poses) const {
    Alignment alignment;
    alignment.T_imu_sensor = {attitude_.R_imu_sensor, solution_.leverArm()};
    alignment.gravity = kGravity;
    alignment.gyro_bias = attitude_.gyro_bias;
    alignment.accel_bias = solution_.accelBias();
    alignment.time_offset_s = attitude_.time_offset_s;
    alignment.lever_arm_sigma_m = lever_covariance_.diagonal().cwiseSqrt();
    alignment.lever_arm_guess = params_.lever_arm_guess;
    alignment.lever_arm_prior_m = params_.lever_arm_prior_m;
    alignment.residual_m = rms_;
    alignment.T_W_M.q = Eigen::Quaterniond::FromTwoVectors(solution_.gravity(), -Eigen::Vector3d::UnitZ());
    for (const SensorPose& pose : poses) alignment.states.push_back(state(pose.stamp, alignment));
    return alignment;
  }

  /// Time from a stamp to the nearest chunk [s].
  double distanceToData(TimeNs sensor_stamp) const {
    const TimeNs stamp = sensor_stamp + toNs(attitude_.time_offset_s);
    const InertialPath& path = attitude_.chunks[nearestChunk(stamp)].path;
    return std::max({0.0, toSeconds(path.start() - stamp), toSeconds(stamp - path.end())});
  }

 private:
  PositionEquation equation(std::size_t c, const SensorPose& pose) const {
    const InertialIncrement increment = attitude_.chunks[c].path.at(pose.stamp + toNs(attitude_.time_offset_s));
    const Eigen::Matrix3d R_M_chunk = attitude_.R_M_chunk[c].toRotationMatrix();
    PositionEquation result{c, pose.T_M_S.t - R_M_chunk * increment.p, {}, {}};
    result.J_local << Eigen::Matrix3d::Identity(), increment.time_s * Eigen::Matrix3d::Identity();
    result.J_shared.middleCols<3>(kGravityRow) =
        0.5 * increment.time_s * increment.time_s * Eigen::Matrix3d::Identity();
    result.J_shared.middleCols<3>(kAccelBiasRow) = R_M_chunk * increment.p_ba;
    result.J_shared.middleCols<3>(kLeverRow) = (attitude_.R_M_chunk[c] * increment.R_0_t).toRotationMatrix();
    result.known = pose.seen_directions * result.known;
    result.J_local = pose.seen_directions * result.J_local;
    result.J_shared = pose.seen_directions * result.J_shared;
    return result;
  }

  void accumulate(const std::vector<double>& weights) {
    chunks_.assign(attitude_.chunks.size(), {});
    const double information = 1.0 / (sigma_ * sigma_);
    for (ChunkEquations& chunk : chunks_) {
      chunk.H_local.diagonal().head<3>().setConstant(1.0 / (kPositionPrior_m * kPositionPrior_m));
      chunk.H_local.diagonal().tail<3>().setConstant(1.0 / (kVelocityPrior * kVelocityPrior));
    }
    for (std::size_t i = 0; i < equations_.size(); ++i) {
      const PositionEquation& row = equations_[i];
      ChunkEquations& chunk = chunks_[row.chunk];
      const double weight = weights[i] * information;
      const Eigen::Matrix<double, 3, 6>& J = row.J_local;
      chunk.H_local += weight * J.transpose() * J;
      chunk.H_cross += weight * J.transpose() * row.J_shared;
      chunk.b_local += weight * J.transpose() * row.known;
      chunk.shared.H += weight * row.J_shared.transpose() * row.J_shared;
      chunk.shared.b += weight * row.J_shared.transpose() * row.known;
    }
  }

  /// Cauchy weights; the scale is the residuals' own, but not below the stated noise.
  void reweight(std::vector<double>& weights) {
    std::vector<double> lengths(equations_.size());
    for (std::size_t i = 0; i < equations_.size(); ++i) {
      const PositionEquation& row = equations_[i];
      lengths[i] = (row.known - row.J_local * starts_[row.chunk] - row.J_shared * solution_.x).norm();
    }
    measured_sigma_ = medianOf(lengths) / kMedianLength3;
    sigma_ = std::max(params_.position_sigma_m, measured_sigma_);
    double sum = 0.0, weighted = 0.0;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
      weights[i] = cauchyWeight(lengths[i], kCauchySigmas * sigma_);
      sum += weights[i];
      weighted += weights[i] * lengths[i] * lengths[i];
    }
    rms_ = std::sqrt(weighted / sum);
  }

  std::size_t nearestChunk(TimeNs stamp) const {
    std::size_t chunk = 0;
    while (chunk + 1 < attitude_.chunks.size() && attitude_.chunks[chunk + 1].path.start() <= stamp) ++chunk;
    return chunk;
  }

  NavState state(TimeNs sensor_stamp, const Alignment& alignment) const {
    const TimeNs stamp = sensor_stamp + toNs(attitude_.time_offset_s);
    const std::size_t c = nearestChunk(stamp);
    const InertialIncrement increment = attitude_.chunks[c].path.at(stamp);
    const Eigen::Quaterniond& R_M_chunk = attitude_.R_M_chunk[c];
    const Eigen::Vector3d accel_bias = solution_.accelBias();
    const double t = increment.time_s;
    const Vector6& start = starts_[c];
    const Eigen::Vector3d v_M =
        start.tail<3>() + t * solution_.gravity() + R_M_chunk * (increment.v + increment.v_ba * accel_bias);
    const Eigen::Vector3d p_M = start.head<3>() + t * start.tail<3>() + 0.5 * t * t * solution_.gravity() +
                                R_M_chunk * (increment.p + increment.p_ba * accel_bias);
    NavState result;
    result.stamp = stamp;
    result.T_W_I = alignment.T_W_M * Pose{R_M_chunk * increment.R_0_t, p_M};
    result.v_W = alignment.T_W_M.q * v_M;
    result.gyro_bias = attitude_.gyro_bias;
    result.accel_bias = accel_bias;
    return result;
  }

  AttitudeFit attitude_;
  AlignmentParams params_;
  SharedInformation prior_;
  std::vector<PositionEquation> equations_;
  std::vector<ChunkEquations> chunks_;
  std::vector<Vector6> starts_;
  SharedSolution free_, solution_;
  Eigen::Matrix3d lever_covariance_ = Eigen::Matrix3d::Identity();
  double sigma_ = 1.0, measured_sigma_ = 0.0, rms_ = 0.0;
};

/// What speaks against an alignment; empty if nothing.
std::string doubt(const PoseAlignment& alignment, const AlignmentParams& params) {
  const double gravity = alignment.freeSolution().gravity().norm();
  if (!std::isfinite(gravity)) return "positions and imu are inconsistent";
  if (alignment.residualSigma() > kMostResiduals * params.position_sigma_m) {
    return text("the sensor's positions do not fit the imu (%.3f m): check the imu's axes and units, and the tracking",
                alignment.residualSigma());
  }
  if (std::abs(gravity - kGravity) > kGravityTolerance + 3.0 * alignment.freeSolution().gravitySigma()) {
    return text("gravity comes out as %.2f m/s^2: check the accelerometer's unit and scale", gravity);
  }
  if (alignment.worstLeverSigma() > params.max_lever_arm_sigma_m)
    return missingLeverMotion(alignment.leverCovariance());
  return {};
}

/// Why the poses cannot be used as they are; empty if they can.
std::string inputDoubt(const std::vector<SensorPose>& poses) {
  if (poses.size() < kFewestPoses) return text("only %.0f poses so far: keep moving", double(poses.size()));
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i].T_M_S.t.allFinite() || !poses[i].T_M_S.q.coeffs().allFinite()) return "a pose is not finite";
    if (i > 0 && poses[i].stamp <= poses[i - 1].stamp) return "the poses' stamps do not rise";
  }
  if (toSeconds(poses.back().stamp - poses.front().stamp) < kShortest_s) {
    return text("only %.1f s of motion so far: keep moving", toSeconds(poses.back().stamp - poses.front().stamp));
  }
  return {};
}

}  // namespace

std::optional<Alignment> alignFromPoses(const ImuBuffer& imu, const RotationInitialization& rotation,
                                        const std::vector<SensorPose>& poses, const AlignmentParams& params,
                                        std::string* reason) {
  const auto refuse = [reason](const std::string& why) {
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  };
  if (const std::string why = inputDoubt(poses); !why.empty()) return refuse(why);
  std::vector<TimeNs> stamps;
  std::vector<Eigen::Quaterniond> R_M_S;
  for (const SensorPose& pose : poses) {
    stamps.push_back(pose.stamp);
    R_M_S.push_back(pose.T_M_S.q);
  }
  const double duration = toSeconds(stamps.back() - stamps.front());

  // Long chunks show slow rotations of the lever arm, short ones forgive the IMU: take what is the most certain.
  std::optional<PoseAlignment> best;
  for (double chunk_s = params.chunk_s; chunk_s <= std::max(params.chunk_s, 0.7 * duration); chunk_s *= 2.0) {
    auto attitude = fitAttitude(imu, rotation, stamps, R_M_S, chunk_s);
    if (!attitude) return refuse("the imu does not cover the poses: check its rate, and the clocks of both");
    PoseAlignment alignment(std::move(*attitude), poses, params);
    alignment.solve();
    if (!best || alignment.uncertainty() < best->uncertainty()) best.emplace(std::move(alignment));
  }
  for (const TimeNs stamp : stamps) {
    if (best->distanceToData(stamp) > kFarthestUncovered_s) {
      return refuse("the imu does not cover all poses: check its rate, and the clocks of both");
    }
  }
  if (const std::string why = doubt(*best, params); !why.empty()) return refuse(why);
  return best->result(poses);
}

}  // namespace cocalib
