#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/track_alignment.h"

namespace cocalib {
namespace {

// The shared block: tangent coordinates of gravity's direction, then changes against the problem's values.
constexpr int kGravity = 0, kAccelBias = 2, kLever = 5, kGyroBias = 8, kMounting = 11, kOffset = 14, kShared = 15;
// Priors of what rotation initialisation found [rad/s], [rad], [s], and the gyro-free continuity of velocity [m/s].
constexpr double kGyroBiasPrior = 0.03, kMountingPrior = 0.05, kOffsetPrior = 0.01, kVelocityContinuity = 0.02;
constexpr double kCauchySigmas = 2.0;
constexpr double kFarthest_m = 100.0;
constexpr double kLeastDepth = 0.05;

template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Matrix3 = Eigen::Matrix<T, 3, 3>;

/// First-order rotation of `v` by a small rotation vector; second order kept, so that bias and mounting may move by
/// some degrees.
template <typename T>
Vector3<T> rotateSmall(const Vector3<T>& phi, const Vector3<T>& v) {
  const Vector3<T> once = phi.cross(v);
  return v + once + T(0.5) * phi.cross(once);
}

/// Direction and magnitude of gravity in G from the tangent coordinates.
struct GravityChart {
  explicit GravityChart(const Eigen::Vector3d& gravity_G)
      : direction(gravity_G.normalized()), basis(tangentBasis(direction)) {}

  template <typename T>
  Vector3<T> gravity(const T* shared) const {
    const Vector3<T> moved =
        direction.cast<T>() + basis.cast<T>() * Eigen::Map<const Eigen::Matrix<T, 2, 1>>(shared + kGravity);
    return T(kStandardGravity) * moved.normalized();
  }

  Eigen::Vector3d direction;
  Eigen::Matrix<double, 3, 2> basis;
};

/// A camera at one frame: everything that the shared unknowns and the chunk's velocity move.
struct CameraModelAtFrame {
  CameraModelAtFrame(const TrackProblem& problem, std::size_t frame)
      : increment(problem.increments[frame]),
        R_G_chunk(problem.R_G_chunk[problem.chunk_of_frame[frame]].toRotationMatrix()),
        chunk_bg(problem.R_G_chunk_bg[problem.chunk_of_frame[frame]]),
        R_chunk_I(increment.R_0_t.toRotationMatrix()) {}

  /// v_I -> v_G, with bias and offset corrections.
  template <typename T>
  Vector3<T> toG(const T* shared, const Vector3<T>& v_I) const {
    const Vector3<T> bias = Eigen::Map<const Vector3<T>>(shared + kGyroBias);
    const Vector3<T> turn = increment.R_bg.cast<T>() * bias + increment.rate.cast<T>() * shared[kOffset];
    const Vector3<T> v_chunk = R_chunk_I.cast<T>() * rotateSmall<T>(turn, v_I);
    return chunkToG<T>(shared, v_chunk);
  }

  template <typename T>
  Vector3<T> chunkToG(const T* shared, const Vector3<T>& v_chunk) const {
    const Vector3<T> bias = Eigen::Map<const Vector3<T>>(shared + kGyroBias);
    return R_G_chunk.cast<T>() * rotateSmall<T>(chunk_bg.cast<T>() * bias, v_chunk);
  }

  template <typename T>
  Vector3<T> cameraPosition(const T* shared, const T* velocity, const GravityChart& chart) const {
    const Vector3<T> gyro_bias = Eigen::Map<const Vector3<T>>(shared + kGyroBias);
    const Vector3<T> accel_bias = Eigen::Map<const Vector3<T>>(shared + kAccelBias);
    const Vector3<T> lever = Eigen::Map<const Vector3<T>>(shared + kLever);
    const T t = T(increment.time_s) + shared[kOffset];
    const Vector3<T> p = increment.p.cast<T>() + increment.p_bg.cast<T>() * gyro_bias +
                         increment.p_ba.cast<T>() * accel_bias + increment.v.cast<T>() * shared[kOffset];
    return t * Eigen::Map<const Vector3<T>>(velocity) + T(0.5) * t * t * chart.gravity(shared) +
           chunkToG<T>(shared, p) + toG<T>(shared, lever);
  }

  InertialIncrement increment;
  Eigen::Matrix3d R_G_chunk, chunk_bg, R_chunk_I;
};

/// A landmark seen again: bearing error [sigma], two components. Landmark block: two tangent coordinates of the bearing
/// in the first camera, and inverse depth there [1/m].
class SightCost {
 public:
  SightCost(const TrackProblem& problem, const ChunkTrack& track, std::size_t sight, const GravityChart& chart,
            double sigma_rad)
      : anchor_(problem, track.sights.front().frame),
        camera_(problem, track.sights[sight].frame),
        R_I_C_(problem.R_imu_camera.toRotationMatrix()),
        anchor_bearing_(track.sights.front().bearing_C),
        anchor_basis_(tangentBasis(anchor_bearing_)),
        bearing_(track.sights[sight].bearing_C),
        basis_(tangentBasis(bearing_)),
        chart_(chart),
        inv_sigma_(1.0 / sigma_rad) {}

  template <typename T>
  bool operator()(const T* velocity, const T* shared, const T* landmark, T* residual) const {
    const Vector3<T> mounting = Eigen::Map<const Vector3<T>>(shared + kMounting);
    const Vector3<T> ray_C =
        anchor_bearing_.cast<T>() + anchor_basis_.cast<T>() * Eigen::Map<const Eigen::Matrix<T, 2, 1>>(landmark);
    const Vector3<T> ray_I = rotateSmall<T>(mounting, R_I_C_.cast<T>() * ray_C);
    const Vector3<T> shift =
        anchor_.cameraPosition(shared, velocity, chart_) - camera_.cameraPosition(shared, velocity, chart_);
    const Vector3<T> ray_G = anchor_.toG<T>(shared, ray_I) + landmark[2] * shift;
    // Components of the ray along the measured bearing and across it, all taken to G.
    const auto along = [&](const Eigen::Vector3d& axis_C) {
      const Vector3<T> axis_I = rotateSmall<T>(mounting, (R_I_C_ * axis_C).cast<T>());
      return ray_G.dot(camera_.toG<T>(shared, axis_I));
    };
    // In the first camera's depth; a wrong track may come out behind the camera, and is left to the robust loss.
    T depth = along(bearing_);
    if (depth < T(kLeastDepth)) depth = T(kLeastDepth);
    residual[0] = T(inv_sigma_) * along(basis_.col(0)) / depth;
    residual[1] = T(inv_sigma_) * along(basis_.col(1)) / depth;
    return true;
  }

 private:
  CameraModelAtFrame anchor_, camera_;
  Eigen::Matrix3d R_I_C_;
  Eigen::Vector3d anchor_bearing_;
  Eigen::Matrix<double, 3, 2> anchor_basis_;
  Eigen::Vector3d bearing_;
  Eigen::Matrix<double, 3, 2> basis_;
  GravityChart chart_;
  double inv_sigma_;
};

/// The first sight itself: the landmark's tangent coordinates are its bearing's error.
class AnchorCost {
 public:
  explicit AnchorCost(double sigma_rad) : inv_sigma_(1.0 / sigma_rad) {}
  template <typename T>
  bool operator()(const T* landmark, T* residual) const {
    residual[0] = T(inv_sigma_) * landmark[0];
    residual[1] = T(inv_sigma_) * landmark[1];
    return true;
  }

 private:
  double inv_sigma_;
};

/// The IMU carries one chunk's velocity to the next one's start.
class VelocityCost {
 public:
  VelocityCost(const TrackProblem& problem, std::size_t chunk, const GravityChart& chart)
      : camera_(problem, problem.chunks[chunk].begin),
        whole_(problem.chunks[chunk].path.at(problem.chunks[chunk + 1].path.start())),
        chart_(chart) {}

  template <typename T>
  bool operator()(const T* velocity, const T* next_velocity, const T* shared, T* residual) const {
    const Vector3<T> gyro_bias = Eigen::Map<const Vector3<T>>(shared + kGyroBias);
    const Vector3<T> accel_bias = Eigen::Map<const Vector3<T>>(shared + kAccelBias);
    const Vector3<T> gained =
        whole_.v.cast<T>() + whole_.v_bg.cast<T>() * gyro_bias + whole_.v_ba.cast<T>() * accel_bias;
    Eigen::Map<Vector3<T>> r(residual);
    r = Eigen::Map<const Vector3<T>>(velocity) + T(whole_.time_s) * chart_.gravity(shared) +
        camera_.chunkToG<T>(shared, gained) - Eigen::Map<const Vector3<T>>(next_velocity);
    r /= T(kVelocityContinuity);
    return true;
  }

 private:
  CameraModelAtFrame camera_;
  InertialIncrement whole_;
  GravityChart chart_;
};

/// Priors of the shared block, each in its own sigma, about zero but for the lever arm; gravity's direction has none.
class PriorCost {
 public:
  explicit PriorCost(const AlignmentParams& params) {
    sigma_.segment<3>(kAccelBias).setConstant(params.accel_bias_sigma);
    sigma_.segment<3>(kLever).setConstant(params.lever_arm_prior_m);
    sigma_.segment<3>(kGyroBias).setConstant(kGyroBiasPrior);
    sigma_.segment<3>(kMounting).setConstant(kMountingPrior);
    sigma_[kOffset] = kOffsetPrior;
    centre_.segment<3>(kLever) = params.lever_arm_guess;
  }
  template <typename T>
  bool operator()(const T* shared, T* residual) const {
    for (int i = kAccelBias; i < kShared; ++i) residual[i - kAccelBias] = (shared[i] - T(centre_[i])) / T(sigma_[i]);
    return true;
  }

 private:
  Eigen::Matrix<double, kShared, 1> sigma_ = Eigen::Matrix<double, kShared, 1>::Ones();
  Eigen::Matrix<double, kShared, 1> centre_ = Eigen::Matrix<double, kShared, 1>::Zero();
};

class TrackRefiner {
 public:
  TrackRefiner(const TrackProblem& problem, const TrackSolution& start, const AlignmentParams& params)
      : problem_(problem), start_(start), chart_(start.shared.gravity()), velocities_(start.velocities) {
    Eigen::Map<Eigen::Vector3d>(shared_.data() + kAccelBias) = start.shared.accelBias();
    Eigen::Map<Eigen::Vector3d>(shared_.data() + kLever) = start.shared.leverArm();
    startLandmarks();
    build(params);
  }

  std::optional<TrackRefinement> solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.max_num_iterations = 10;
    options.function_tolerance = 1e-5;
    options.num_threads = 1;  // the same input must give the same output
    options.logging_type = ceres::SILENT;
    options.linear_solver_ordering.reset(new ceres::ParameterBlockOrdering);
    for (auto& landmark : landmarks_) options.linear_solver_ordering->AddElementToGroup(landmark.data(), 0);
    for (auto& velocity : velocities_) options.linear_solver_ordering->AddElementToGroup(velocity.data(), 1);
    options.linear_solver_ordering->AddElementToGroup(shared_.data(), 1);
    ceres::Solver::Summary summary;
    ceres::Solve(options, &ceres_, &summary);
    if (!summary.IsSolutionUsable()) return std::nullopt;
    return result();
  }

 private:
  void startLandmarks() {
    landmarks_.resize(problem_.tracks.size());
    for (std::size_t k = 0; k < landmarks_.size(); ++k) {
      const ChunkTrack& track = problem_.tracks[k];
      const CameraModelAtFrame anchor(problem_, track.sights.front().frame);
      const Eigen::Vector3d p_C = anchor.cameraPosition(shared_.data(), velocities_[track.chunk].data(), chart_);
      const double depth =
          (track.X_G - p_C).dot(problem_.R_G_C(track.sights.front().frame) * track.sights.front().bearing_C);
      landmarks_[k] = {0.0, 0.0, depth > 0.0 ? 1.0 / std::clamp(depth, 0.3, kFarthest_m) : 1.0 / kFarthest_m};
    }
  }

  void build(const AlignmentParams& params) {
    const double sigma = start_.bearing_sigma_rad;
    for (std::size_t k = 0; k < problem_.tracks.size(); ++k) {
      const ChunkTrack& track = problem_.tracks[k];
      double* landmark = landmarks_[k].data();
      ceres_.AddResidualBlock(new ceres::AutoDiffCostFunction<AnchorCost, 2, 3>(new AnchorCost(sigma)),
                              new ceres::CauchyLoss(kCauchySigmas), landmark);
      for (std::size_t s = 1; s < track.sights.size(); ++s) {
        ceres_.AddResidualBlock(new ceres::AutoDiffCostFunction<SightCost, 2, 3, kShared, 3>(
                                    new SightCost(problem_, track, s, chart_, sigma)),
                                new ceres::CauchyLoss(kCauchySigmas), velocities_[track.chunk].data(), shared_.data(),
                                landmark);
      }
    }
    for (std::size_t c = 0; c + 1 < problem_.chunks.size(); ++c) {
      ceres_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<VelocityCost, 3, 3, 3, kShared>(new VelocityCost(problem_, c, chart_)),
          nullptr, velocities_[c].data(), velocities_[c + 1].data(), shared_.data());
    }
    ceres_.AddResidualBlock(
        new ceres::AutoDiffCostFunction<PriorCost, kShared - kAccelBias, kShared>(new PriorCost(params)), nullptr,
        shared_.data());
  }

  /// Information of (shared, velocities) with the landmarks eliminated.
  Eigen::MatrixXd reducedInformation() {
    ceres::Problem::EvaluateOptions options;
    options.parameter_blocks.push_back(shared_.data());
    for (auto& velocity : velocities_) options.parameter_blocks.push_back(velocity.data());
    for (auto& landmark : landmarks_) options.parameter_blocks.push_back(landmark.data());
    ceres::CRSMatrix jacobian;
    ceres_.Evaluate(options, nullptr, nullptr, nullptr, &jacobian);
    const int dense = kShared + 3 * static_cast<int>(velocities_.size());
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(dense, dense);
    std::vector<Eigen::MatrixXd> cross(landmarks_.size(), Eigen::MatrixXd::Zero(3, dense));
    std::vector<Eigen::Matrix3d> own(landmarks_.size(), 1e-9 * Eigen::Matrix3d::Identity());
    for (int row = 0; row < jacobian.num_rows; ++row) {
      for (int i = jacobian.rows[row]; i < jacobian.rows[row + 1]; ++i) {
        for (int j = jacobian.rows[row]; j < jacobian.rows[row + 1]; ++j) {
          const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
          const int col_a = jacobian.cols[a], col_b = jacobian.cols[b];
          const double product = jacobian.values[a] * jacobian.values[b];
          if (col_a < dense && col_b < dense) {
            H(col_a, col_b) += product;
          } else if (col_a >= dense) {
            const auto k = static_cast<std::size_t>((col_a - dense) / 3);
            const int r = (col_a - dense) % 3;
            if (col_b < dense) cross[k](r, col_b) += product;
            if (col_b >= dense) own[k](r, (col_b - dense) % 3) += product;
          }
        }
      }
    }
    for (std::size_t k = 0; k < landmarks_.size(); ++k) H -= cross[k].transpose() * own[k].ldlt().solve(cross[k]);
    return H;
  }

  TrackRefinement result() {
    const Eigen::MatrixXd information = reducedInformation();
    const Eigen::MatrixXd covariance =
        information.ldlt().solve(Eigen::MatrixXd::Identity(information.rows(), information.cols()));
    TrackRefinement refined{start_, problem_.R_imu_camera, problem_.gyro_bias, problem_.time_offset_s};
    TrackSolution& solution = refined.solution;
    solution.shared.x.segment<3>(kGravityRow) = chart_.gravity(shared_.data());
    solution.shared.x.segment<3>(kAccelBiasRow) = Eigen::Map<const Eigen::Vector3d>(shared_.data() + kAccelBias);
    solution.shared.x.segment<3>(kLeverRow) = Eigen::Map<const Eigen::Vector3d>(shared_.data() + kLever);
    solution.shared.covariance.setZero();
    solution.shared.covariance.block<6, 6>(kAccelBiasRow, kAccelBiasRow) =
        covariance.block<6, 6>(kAccelBias, kAccelBias);
    solution.velocities = velocities_;
    const Eigen::Index velocities = information.rows() - kShared;
    solution.worst_velocity_sigma = std::sqrt(std::max(0.0, covariance.diagonal().tail(velocities).maxCoeff()));
    refined.R_imu_camera =
        (expSo3(Eigen::Map<const Eigen::Vector3d>(shared_.data() + kMounting)) * problem_.R_imu_camera).normalized();
    refined.gyro_bias += Eigen::Map<const Eigen::Vector3d>(shared_.data() + kGyroBias);
    refined.time_offset_s += shared_[kOffset];
    return refined;
  }

  const TrackProblem& problem_;
  const TrackSolution& start_;
  GravityChart chart_;
  std::array<double, kShared> shared_{};
  std::vector<Eigen::Vector3d> velocities_;
  std::vector<std::array<double, 3>> landmarks_;
  ceres::Problem ceres_;
};

}  // namespace

std::optional<TrackRefinement> refineTracks(const TrackProblem& problem, const TrackSolution& start,
                                            const AlignmentParams& params) {
  return TrackRefiner(problem, start, params).solve();
}

}  // namespace cocalib
