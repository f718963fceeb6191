#include "cocalib/initialization/attitude_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/robust.h"

namespace cocalib {
namespace {

constexpr int kIterations = 8;
constexpr double kCauchySigmas = 2.0;
constexpr double kSmallestSigma_rad = 1e-4;
constexpr double kDrift_rad = 2e-3;  // of a sensor's map, and of the gyro, from chunk to chunk
// Weak priors about the start: they hold what a short or one-sided motion does not show.
constexpr double kBiasPrior = 0.03;  // [rad/s]
constexpr double kMountingPrior_rad = 0.03;
constexpr double kOffsetPrior_s = 0.01;

/// Columns of the shared unknowns: gyro bias, mounting rotation (from the left), offset. Chunks follow.
constexpr int kBias = 0, kMounting = 3, kOffset = 6, kShared = 7;

std::vector<TimeNs> imuStamps(const std::vector<TimeNs>& sensor_stamps, double offset_s) {
  std::vector<TimeNs> stamps = sensor_stamps;
  for (TimeNs& stamp : stamps) stamp += toNs(offset_s);
  return stamps;
}

class AttitudeProblem {
 public:
  AttitudeProblem(const ImuBuffer& imu, const RotationInitialization& start, const std::vector<TimeNs>& sensor_stamps,
                  const std::vector<Eigen::Quaterniond>& R_M_S, double chunk_s)
      : imu_(imu), start_(start), stamps_(sensor_stamps), R_M_S_(R_M_S), chunk_s_(chunk_s) {
    fit_.R_imu_sensor = start.R_imu_sensor;
    fit_.gyro_bias = start.gyro_bias;
    fit_.time_offset_s = start.time_offset_s;
  }

  std::optional<AttitudeFit> solve() {
    integrate();
    if (fit_.chunks.empty()) return std::nullopt;
    for (const Chunk& chunk : fit_.chunks) fit_.R_M_chunk.push_back(medoid(chunk));
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      step();
      integrate();
    }
    return fit_;
  }

 private:
  /// The split never changes with the few milliseconds by which the offset moves: stamps are taken at the start's.
  void integrate() {
    fit_.chunks = splitIntoChunks(imu_, imuStamps(stamps_, start_.time_offset_s), chunk_s_, fit_.gyro_bias,
                                  Eigen::Vector3d::Zero());
  }

  InertialIncrement incrementAt(const Chunk& chunk, std::size_t i) const {
    return chunk.path.at(stamps_[i] + toNs(fit_.time_offset_s));
  }

  /// Orientation at the chunk's start that agrees best with the others: no outlier.
  Eigen::Quaterniond medoid(const Chunk& chunk) const {
    std::vector<Eigen::Quaterniond> starts;
    for (std::size_t i = chunk.begin; i < chunk.end; ++i) {
      starts.push_back(R_M_S_[i] * fit_.R_imu_sensor.conjugate() * incrementAt(chunk, i).R_0_t.conjugate());
    }
    double best = std::numeric_limits<double>::infinity();
    Eigen::Quaterniond result = starts.front();
    for (const Eigen::Quaterniond& candidate : starts) {
      std::vector<double> angles;
      for (const Eigen::Quaterniond& other : starts) angles.push_back(candidate.angularDistance(other));
      const double median = medianOf(angles);
      if (median < best) {
        best = median;
        result = candidate;
      }
    }
    return result;
  }

  struct Residual {
    std::size_t chunk;
    Eigen::Vector3d r;
    Eigen::Matrix<double, 3, kShared> J_shared;
    Eigen::Matrix3d J_chunk;
  };

  /// r = Log(prediction^T R_M_S), prediction = R_M_chunk R_chunk_I R_imu_sensor; left perturbations.
  Residual evaluate(std::size_t c, std::size_t i) const {
    const InertialIncrement increment = incrementAt(fit_.chunks[c], i);
    const Eigen::Quaterniond prediction = fit_.R_M_chunk[c] * increment.R_0_t * fit_.R_imu_sensor;
    Residual residual{c, logSo3(prediction.conjugate() * R_M_S_[i]), {}, {}};
    const Eigen::Matrix3d left = -inverseLeftJacobianSo3(residual.r);
    const Eigen::Matrix3d R_S_I = fit_.R_imu_sensor.conjugate().toRotationMatrix();
    residual.J_shared.middleCols<3>(kBias) = left * R_S_I * increment.R_bg;
    residual.J_shared.middleCols<3>(kMounting) = left * R_S_I;
    residual.J_shared.col(kOffset) = left * R_S_I * increment.rate;
    residual.J_chunk = left * prediction.conjugate().toRotationMatrix();
    return residual;
  }

  void addResiduals(Eigen::MatrixXd& H, Eigen::VectorXd& g) {
    std::vector<Residual> residuals;
    std::vector<double> lengths;
    for (std::size_t c = 0; c < fit_.chunks.size(); ++c) {
      for (std::size_t i = fit_.chunks[c].begin; i < fit_.chunks[c].end; ++i) {
        residuals.push_back(evaluate(c, i));
        lengths.push_back(residuals.back().r.norm());
      }
    }
    fit_.residual_rad = std::max(medianOf(lengths) / kMedianLength3, kSmallestSigma_rad);
    const double information = 1.0 / (fit_.residual_rad * fit_.residual_rad);
    for (const Residual& residual : residuals) {
      const double weight = information * cauchyWeight(residual.r.norm(), kCauchySigmas * fit_.residual_rad);
      const auto column = kShared + 3 * static_cast<Eigen::Index>(residual.chunk);
      Eigen::Matrix<double, 3, kShared + 3> J;
      J << residual.J_shared, residual.J_chunk;
      const Eigen::Matrix<double, kShared + 3, kShared + 3> JtJ = weight * J.transpose() * J;
      const Eigen::Matrix<double, kShared + 3, 1> Jtr = weight * J.transpose() * residual.r;
      H.topLeftCorner<kShared, kShared>() += JtJ.topLeftCorner<kShared, kShared>();
      H.block<kShared, 3>(0, column) += JtJ.topRightCorner<kShared, 3>();
      H.block<3, kShared>(column, 0) += JtJ.bottomLeftCorner<3, kShared>();
      H.block<3, 3>(column, column) += JtJ.bottomRightCorner<3, 3>();
      g.head<kShared>() += Jtr.head<kShared>();
      g.segment<3>(column) += Jtr.tail<3>();
    }
  }

  /// r = Log((R_M_c R_c_next)^T R_M_next): the gyro carries one chunk's orientation to the next one's start.
  void addContinuity(Eigen::MatrixXd& H, Eigen::VectorXd& g) const {
    constexpr double kInformation = 1.0 / (kDrift_rad * kDrift_rad);
    for (std::size_t c = 0; c + 1 < fit_.chunks.size(); ++c) {
      if (!fit_.chunks[c].continues_in_next) continue;
      const InertialIncrement increment = fit_.chunks[c].path.at(fit_.chunks[c + 1].path.start());
      const Eigen::Quaterniond prediction = fit_.R_M_chunk[c] * increment.R_0_t;
      const Eigen::Vector3d r = logSo3(prediction.conjugate() * fit_.R_M_chunk[c + 1]);
      Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3, H.cols());
      const auto column = kShared + 3 * static_cast<Eigen::Index>(c);
      J.middleCols<3>(kBias) = -increment.R_bg;
      J.middleCols<3>(column) = -prediction.conjugate().toRotationMatrix();
      J.middleCols<3>(column + 3) = prediction.conjugate().toRotationMatrix();
      H += kInformation * J.transpose() * J;
      g += kInformation * J.transpose() * r;
    }
  }

  void addPriors(Eigen::MatrixXd& H, Eigen::VectorXd& g) const {
    Eigen::Matrix<double, kShared, 1> deviation, information;
    deviation << fit_.gyro_bias - start_.gyro_bias, logSo3(fit_.R_imu_sensor * start_.R_imu_sensor.conjugate()),
        fit_.time_offset_s - start_.time_offset_s;
    information << Eigen::Vector3d::Constant(1.0 / (kBiasPrior * kBiasPrior)),
        Eigen::Vector3d::Constant(1.0 / (kMountingPrior_rad * kMountingPrior_rad)),
        1.0 / (kOffsetPrior_s * kOffsetPrior_s);
    H.diagonal().head<kShared>() += information;
    g.head<kShared>() += information.cwiseProduct(deviation);
  }

  void step() {
    const Eigen::Index size = kShared + 3 * static_cast<Eigen::Index>(fit_.chunks.size());
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
    addResiduals(H, g);
    addContinuity(H, g);
    addPriors(H, g);
    const Eigen::VectorXd delta = -H.ldlt().solve(g);
    fit_.gyro_bias += delta.segment<3>(kBias);
    fit_.R_imu_sensor = (expSo3(delta.segment<3>(kMounting)) * fit_.R_imu_sensor).normalized();
    fit_.time_offset_s += delta[kOffset];
    for (std::size_t c = 0; c < fit_.chunks.size(); ++c) {
      const Eigen::Vector3d turn = delta.segment<3>(kShared + 3 * static_cast<Eigen::Index>(c));
      fit_.R_M_chunk[c] = (expSo3(turn) * fit_.R_M_chunk[c]).normalized();
    }
  }

  const ImuBuffer& imu_;
  const RotationInitialization& start_;
  const std::vector<TimeNs>& stamps_;
  const std::vector<Eigen::Quaterniond>& R_M_S_;
  double chunk_s_;
  AttitudeFit fit_;
};

}  // namespace

std::optional<AttitudeFit> fitAttitude(const ImuBuffer& imu, const RotationInitialization& start,
                                       const std::vector<TimeNs>& sensor_stamps,
                                       const std::vector<Eigen::Quaterniond>& R_M_S, double chunk_s) {
  return AttitudeProblem(imu, start, sensor_stamps, R_M_S, chunk_s).solve();
}

}  // namespace cocalib
