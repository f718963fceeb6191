#pragma once

#include <Eigen/Core>

namespace cocalib::sim {

/// The way through the building: once around its court, a rounded rectangle
///
///   x = 10.55 (cos a - 0.1 cos 3a), y = 7.2 (sin a + 0.1 sin 3a)
///
/// about the building's middle, from restPosition() at a = pi. The rig faces along x at first and turns with `a`.
namespace drive {

constexpr double kMiddleX = 13.695, kMiddleY = 4.0;  ///< [m]
constexpr double kRate = 0.115;                      ///< of `a` [rad/s]: 0.75 to 1.2 m/s

/// Position relative to the begin of the drive and its first two derivatives over a [m].
struct Point {
  Eigen::Vector2d p, dp, ddp;
};
Point at(double angle_since_start);

}  // namespace drive
}  // namespace cocalib::sim
