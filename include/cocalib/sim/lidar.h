#pragma once

#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sim/scenario.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::sim {

/// One beam: when it is fired after the begin of the sweep, by which laser, and where to in the lidar frame.
struct Beam {
  double offset_s = 0.0;
  int ring = 0;
  Eigen::Vector3d direction;  ///< unit length
};

/// The beams of one sweep in the order of firing. Spinning models repeat, the Livox one depends on `k`.
/// Spinning models begin at the rear and turn clockwise seen from above, like the real ones.
/// vlp16: 1800 azimuths of 0.2 deg, 16 lasers -15 to 15 deg fired one after the other every 2.304 us, ring 0 lowest.
std::vector<Beam> sweepBeams(const Scenario& scenario, int k);

/// Number of rings (Livox: lines).
int ringCount(LidarModel model);

struct SimulatedScan {
  LidarScan scan;                     ///< stamps on the lidar clock; NaN points only with lidar.keep_no_return
  std::vector<std::int16_t> surface;  ///< index in Scene::rectangles() that each point lies on; -1: no return
};

/// Sweep k, 0 <= k < scanCount(): each point is measured from the exact pose at its own time.
SimulatedScan simulateScan(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory, int k);

/// Sweeps that end within the recording.
int scanCount(const Scenario& scenario);

}  // namespace cocalib::sim
