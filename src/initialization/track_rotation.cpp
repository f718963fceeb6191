#include "cocalib/initialization/track_rotation.h"

#include <cmath>
#include <limits>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/track_alignment.h"

namespace cocalib {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr int kAngles = 24;
constexpr int kFinerAngles = 6;     // on either side of the best one
constexpr double kFarther = 0.8;    // [rad] from the best angle lies another solution
constexpr double kDistinct = 1.25;  // times the best one's residual, that the next best must have

}  // namespace

std::optional<RotationInitialization> rotationFromTracks(const ImuBuffer& imu, const AxisRotation& turning,
                                                         const std::vector<BearingFrame>& frames, std::string* reason) {
  const AlignmentParams params = AlignmentParams::open(std::nullopt);
  std::string why;
  const auto at = [&](double angle) {
    RotationInitialization rotation = turning.rotation;
    rotation.R_imu_sensor = (expSo3(angle * turning.axis_imu) * rotation.R_imu_sensor).normalized();
    return rotation;
  };
  const auto residualAt = [&](double angle) {
    auto problem = makeTrackProblem(imu, at(angle), frames, params.chunk_s, why);
    return problem ? solveTracksLinearly(*problem, params).bearing_sigma_rad : std::numeric_limits<double>::infinity();
  };
  constexpr double kStep = kTurn / kAngles;
  double best = 0.0, least = std::numeric_limits<double>::infinity();
  std::vector<double> residuals;
  for (int i = 0; i < kAngles; ++i) {
    residuals.push_back(residualAt(i * kStep));
    if (residuals.back() >= least) continue;
    least = residuals.back();
    best = i * kStep;
  }
  double next = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kAngles; ++i) {
    if (std::abs(std::remainder(i * kStep - best, kTurn)) > kFarther) {
      next = std::min(next, residuals[static_cast<std::size_t>(i)]);
    }
  }
  const double coarse = best;
  for (int i = -kFinerAngles; i <= kFinerAngles; ++i) {
    const double angle = coarse + i * 0.5 * kStep / kFinerAngles;
    const double residual = residualAt(angle);
    if (residual >= least) continue;
    least = residual;
    best = angle;
  }
  if (!(least * kDistinct < next)) {
    if (why.empty())
      why =
          "all rotations share one axis, and the accelerations do not tell the turn about it: rotate "
          "about a second axis too, or speed up and slow down";
    if (reason != nullptr) *reason = why;
    return std::nullopt;
  }
  return at(best);
}

}  // namespace cocalib
