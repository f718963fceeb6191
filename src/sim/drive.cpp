#include "cocalib/sim/drive.h"

#include <cmath>

namespace cocalib::sim::drive {

Point at(double angle_since_start) {
  constexpr double kPi = 3.141592653589793;
  constexpr double kHalfX = 10.55, kHalfY = 7.2, kSquareness = 0.1;
  constexpr double kStartX = -kHalfX * (1.0 - kSquareness);
  const double a = kPi + angle_since_start;
  const double c = std::cos(a), s = std::sin(a), c3 = std::cos(3.0 * a), s3 = std::sin(3.0 * a);
  Point point;
  point.p << kHalfX * (c - kSquareness * c3) - kStartX, kHalfY * (s + kSquareness * s3);
  point.dp << kHalfX * (-s + 3.0 * kSquareness * s3), kHalfY * (c + 3.0 * kSquareness * c3);
  point.ddp << kHalfX * (-c + 9.0 * kSquareness * c3), kHalfY * (-s - 9.0 * kSquareness * s3);
  return point;
}

}  // namespace cocalib::sim::drive
