#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/track_alignment.h"

namespace cocalib {
namespace {

constexpr std::size_t kFewestFrames = 30;
constexpr double kShortest_s = 3.0;
constexpr int kMostRounds = 5;
// The problem is built anew with the refined gyro bias and mounting until they move by less than this.
constexpr double kSettledBias = 1e-3, kSettledMounting_rad = 3e-3;
constexpr double kMinGravity = 9.5, kMaxGravity = 10.1;  // [m/s^2] when left free, beyond three sigma
constexpr double kMaxBearingSigma_rad = 0.006;           // 3 px of a common camera: not one rigid scene
constexpr double kMaxVelocitySigma = 0.1;                // [m/s], or
constexpr double kMaxVelocityShare = 0.15;               // of the speed: the scale is known to 15 %

std::string text(const char* format, double value) {
  std::array<char, 256> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, value);
  return buffer.data();
}

std::string inputDoubt(const std::vector<BearingFrame>& frames) {
  if (frames.size() < kFewestFrames) return text("only %.0f pictures so far: keep moving", double(frames.size()));
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].stamp <= frames[i - 1].stamp) return "the pictures' stamps do not rise";
  }
  const double duration = toSeconds(frames.back().stamp - frames.front().stamp);
  if (duration < kShortest_s) return text("only %.1f s of motion so far: keep moving", duration);
  return {};
}

/// What speaks against a solution; empty if nothing.
std::string doubt(const TrackSolution& solution) {
  const double gravity = solution.free_gravity.norm();
  if (!std::isfinite(gravity) || !solution.shared.x.allFinite()) return "tracks and imu are inconsistent";
  if (solution.bearing_sigma_rad > kMaxBearingSigma_rad) {
    return text("the tracks do not fit the imu (%.4f rad): check the camera's intrinsics; move with less blur",
                solution.bearing_sigma_rad);
  }
  const double slack = 3.0 * solution.free_gravity_sigma;
  if (gravity < kMinGravity - slack || gravity > kMaxGravity + slack) {
    return text("gravity comes out as %.2f m/s^2: shift the camera more briskly along all axes", gravity);
  }
  double speed = 0.0;
  for (const Eigen::Vector3d& v : solution.velocities) speed += v.squaredNorm() / double(solution.velocities.size());
  if (solution.worst_velocity_sigma > std::max(kMaxVelocitySigma, kMaxVelocityShare * std::sqrt(speed))) {
    return text(
        "the scale is not determined yet (speed known to %.2f m/s only): shift the camera more briskly, "
        "speeding up and slowing down",
        solution.worst_velocity_sigma);
  }
  return {};
}

/// States of all frames in a gravity-aligned world whose origin is the IMU at the first chunk's start.
std::vector<NavState> statesOf(const TrackProblem& problem, const TrackSolution& solution,
                               const std::vector<BearingFrame>& frames, double gravity) {
  const Eigen::Vector3d gravity_G = gravity * solution.shared.gravity().normalized();
  const Eigen::Quaterniond R_W_G = Eigen::Quaterniond::FromTwoVectors(gravity_G, -Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d accel_bias = solution.shared.accelBias();
  const auto shiftAfter = [&](std::size_t c, const InertialIncrement& increment) -> Eigen::Vector3d {
    const double t = increment.time_s;
    return t * solution.velocities[c] + 0.5 * t * t * gravity_G +
           problem.R_G_chunk[c] * (increment.p + increment.p_ba * accel_bias);
  };
  // Each chunk knows shifts from its own start only: they are strung together.
  std::vector<Eigen::Vector3d> starts = {Eigen::Vector3d::Zero()};
  for (std::size_t c = 0; c + 1 < problem.chunks.size(); ++c) {
    starts.push_back(starts[c] + shiftAfter(c, problem.chunks[c].path.at(problem.chunks[c + 1].path.start())));
  }
  std::vector<NavState> states;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    const std::size_t c = problem.chunk_of_frame[f];
    const InertialIncrement& increment = problem.increments[f];
    NavState state;
    state.stamp = frames[f].stamp + toNs(problem.time_offset_s);
    state.T_W_I = {(R_W_G * problem.R_G_I(f)).normalized(), R_W_G * (starts[c] + shiftAfter(c, increment))};
    state.v_W = R_W_G * (solution.velocities[c] + increment.time_s * gravity_G +
                         problem.R_G_chunk[c] * (increment.v + increment.v_ba * accel_bias));
    state.gyro_bias = problem.gyro_bias;
    state.accel_bias = accel_bias;
    states.push_back(state);
  }
  return states;
}

}  // namespace

std::optional<Alignment> alignFromTracks(const ImuBuffer& imu, const RotationInitialization& rotation,
                                         const std::vector<BearingFrame>& frames, const AlignmentParams& params,
                                         std::string* reason) {
  std::string why = inputDoubt(frames);
  const auto refuse = [reason, &why]() {
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  };
  if (!why.empty()) return refuse();

  RotationInitialization current = rotation;
  std::optional<TrackProblem> problem;
  TrackSolution solution;
  for (int round = 0; round < kMostRounds; ++round) {
    problem = makeTrackProblem(imu, current, frames, params.chunk_s, why);
    if (!problem) return refuse();
    const TrackSolution linear = solveTracksLinearly(*problem, params);
    const auto refined = refineTracks(*problem, linear, params);
    if (!refined) {
      why = "tracks and imu are inconsistent";
      return refuse();
    }
    solution = refined->solution;
    const bool settled = (refined->gyro_bias - current.gyro_bias).norm() < kSettledBias &&
                         refined->R_imu_camera.angularDistance(current.R_imu_sensor) < kSettledMounting_rad;
    if (settled && round > 0) break;  // the problem stands at the rotations that the velocities belong to
    current.R_imu_sensor = refined->R_imu_camera;
    current.gyro_bias = refined->gyro_bias;
    current.time_offset_s = refined->time_offset_s;
  }
  if (why = doubt(solution); !why.empty()) return refuse();

  Alignment alignment;
  alignment.T_imu_sensor = {problem->R_imu_camera, solution.shared.leverArm()};
  alignment.gravity = kStandardGravity;
  alignment.gyro_bias = problem->gyro_bias;
  alignment.accel_bias = solution.shared.accelBias();
  alignment.time_offset_s = problem->time_offset_s;
  alignment.lever_arm_sigma_m = solution.shared.leverCovariance().diagonal().cwiseSqrt();
  alignment.lever_arm_guess = params.lever_arm_guess;
  alignment.lever_arm_prior_m = params.lever_arm_prior_m;
  alignment.states = statesOf(*problem, solution, frames, alignment.gravity);
  return alignment;
}

}  // namespace cocalib
