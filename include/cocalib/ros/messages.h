#pragma once

/// This package's messages beside the core's types. Message generation puts the alias `cocalib::VisualKeyframe` (and
/// two more) where the core has structures of the same names, so the aliases get the suffix Msg while the generated
/// headers are read. Include this header, never the generated ones.
#define VisualKeyframe VisualKeyframeMsg
#define LidarKeyframe LidarKeyframeMsg
#define CalibrationEstimate CalibrationEstimateMsg
#include <cocalib/CalibrationEstimate.h>
#include <cocalib/ExtrinsicEstimate.h>
#include <cocalib/ImuState.h>
#include <cocalib/LidarKeyframe.h>
#include <cocalib/VisualKeyframe.h>
#undef VisualKeyframe
#undef LidarKeyframe
#undef CalibrationEstimate
