#include "cocalib/estimation/imu_noise_scale.h"

#include <cmath>
#include <cstdint>
#include <random>

namespace cocalib {
namespace {

constexpr int kRows = 9;            // position, rotation, velocity; the biases' walks are too small to be told
constexpr double kLeastFree = 60;   // residuals, beyond those that the states follow: one in ten of the scale
constexpr std::uint64_t kSeed = 1;  // of the signs

/// Squares and degrees of freedom of one kind of rows.
struct Component {
  double squares = 0.0, rows = 0.0, followed = 0.0;
  double free() const { return rows - followed; }
  bool tells() const { return free() >= kLeastFree; }
  double scale() const { return tells() ? std::sqrt(squares / free()) : 1.0; }
};

bool isGyro(int row) { return row >= 3 && row < 6; }

struct Segment {
  ImuResidual f;
  Eigen::Matrix<double, kRows, 1> signs;
};

std::vector<Segment> segmentsOf(const InertialChain& chain, const WindowState& state) {
  std::mt19937_64 random(kSeed);
  std::vector<Segment> segments(state.nodes.size() - 1);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    segments[i].f = ImuFactor(chain.segment(static_cast<int>(i)), chain.noise())
                        .evaluate(state.nodes[i], state.nodes[i + 1], state.gravity);
    for (int row = 0; row < kRows; ++row) segments[i].signs[row] = (random() & 1U) != 0 ? 1.0 : -1.0;
  }
  return segments;
}

}  // namespace

std::optional<ImuNoiseScale> measureImuNoise(const InertialChain& chain, const WindowState& state,
                                             const ChainSystem& solved) {
  if (state.nodes.size() < 2) return std::nullopt;
  const std::vector<Segment> segments = segmentsOf(chain, state);
  ChainSystem probe = solved;
  for (int i = 0; i < probe.nodes(); ++i) probe.gradient(i).setZero();
  probe.b_global.setZero();
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const auto& [f, z] = segments[k];
    const int i = static_cast<int>(k);
    probe.gradient(i).noalias() -= f.J_i.topRows<kRows>().transpose() * z;
    probe.gradient(i + 1).noalias() -= f.J_j.topRows<kRows>().transpose() * z;
    probe.b_global[GlobalLayout::kGravity] -= f.J_gravity.head<kRows>().dot(z);
  }
  ChainSystem::Step P_Jt_z;
  if (!probe.solve(0.0, &P_Jt_z)) return std::nullopt;

  Component gyro, accel;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const auto& [f, z] = segments[k];
    const Vector15d followed =
        f.J_i * P_Jt_z.nodes[k] + f.J_j * P_Jt_z.nodes[k + 1] + f.J_gravity * P_Jt_z.globals[GlobalLayout::kGravity];
    for (int row = 0; row < kRows; ++row) {
      Component& component = isGyro(row) ? gyro : accel;
      component.squares += f.r[row] * f.r[row];
      component.rows += 1.0;
      component.followed += z[row] * followed[row];
    }
  }
  if (!gyro.tells() && !accel.tells()) return std::nullopt;
  return ImuNoiseScale{gyro.scale(), accel.scale()};
}

}  // namespace cocalib
