#include "cocalib/initialization/open_start.h"

#include "cocalib/initialization/motion_rotation.h"
#include "cocalib/initialization/track_rotation.h"

namespace cocalib {
namespace {

constexpr double kGuessTolerance_rad = 0.5;  // a guess is good to some degrees: beyond this it means something else

/// From rates and accelerations together.
std::optional<RotationInitialization> fromWholeMotion(const ImuBuffer& imu, const SensorMotion& motion,
                                                      const RotationInitializerParams& params, std::string* doubt) {
  if (!motion.poses.empty()) return rotationFromMotion(imu, motion.poses, motion.position_sigma_m, params, doubt);
  const auto turning = rotationAboutOneAxis(imu, motion.rotations, params, doubt);
  if (!turning) return std::nullopt;
  return rotationFromTracks(imu, *turning, motion.bearings, doubt);
}

}  // namespace

std::optional<OpenStart> openStart(const ImuBuffer& imu, const SensorMotion& motion, const std::optional<Pose>& guess,
                                   std::string* reason) {
  const RotationInitializerParams params;
  std::string doubt;
  auto rotation = initializeRotation(imu, motion.rotations, params, reason);
  if (!rotation) rotation = fromWholeMotion(imu, motion, params, &doubt);
  const bool contradicted = guess && rotation && rotation->R_imu_sensor.angularDistance(guess->q) > kGuessTolerance_rad;
  if (!rotation && guess) {
    if (const auto turning = rotationAboutOneAxis(imu, motion.rotations, params, &doubt)) {
      rotation = turning->rotation;
      rotation->R_imu_sensor = guess->q.normalized();
    }
  }
  if (!rotation) {
    *reason = doubt;
    return std::nullopt;
  }
  OpenStart start{*rotation, AlignmentParams::open(contradicted ? std::nullopt : guess)};
  start.alignment.position_sigma_m = motion.position_sigma_m;
  return start;
}

}  // namespace cocalib
