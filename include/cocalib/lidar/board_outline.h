#pragma once

#include <vector>

#include "cocalib/lidar/board_patch.h"
#include "cocalib/lidar/board_segmenter.h"

namespace cocalib::plate {

/// Crossings of the patch's rows over its outline. Left out are ends that say nothing of the plate's edge: where
/// something stands before it, where the plane goes on (a stand), where the sweep itself begins or ends.
std::vector<BoardEdgeCrossing> crossingsOf(const Sweep& sweep, const Patch& patch);

/// The segment that users get: points away from the rim, crossings, plane.
BoardSegment segmentOf(const Sweep& sweep, const Patch& patch);

}  // namespace cocalib::plate
