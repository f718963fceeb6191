#pragma once

#include <string>

#include "cocalib/measurements/measurements.h"
#include "cocalib/ros/messages.h"

namespace cocalib {

/// Keyframes as messages and back; the round trip is exact. Sizes that do not fit together (a foreign or damaged
/// recording) are cut to what fits.
VisualKeyframeMsg toKeyframeMsg(const VisualKeyframe& keyframe, const std::string& camera_frame);
LidarKeyframeMsg toKeyframeMsg(const LidarKeyframe& keyframe, const std::string& lidar_frame);
VisualKeyframe fromKeyframeMsg(const VisualKeyframeMsg& msg);
LidarKeyframe fromKeyframeMsg(const LidarKeyframeMsg& msg);

ImuState toStateMsg(const NavState& state);
NavState fromStateMsg(const ImuState& msg);

}  // namespace cocalib
