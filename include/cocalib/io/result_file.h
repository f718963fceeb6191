#pragma once

#include <string>

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// What the result covers: a rig without a camera has no camera section, and so on.
struct ResultContents {
  bool camera = true;
  bool lidar = true;
};

/// calibration.yaml as text: schema 1, every number with 17 significant digits where it must round-trip.
std::string formatResult(const CalibrationEstimate& estimate, const ResultContents& contents);

/// Writes `text` to `path` atomically (temporary file in the same directory, fsync, rename, fsync of the directory).
/// A process killed meanwhile leaves the old file or the new one, and perhaps its temporary file, hidden as
/// `.NAME.cocalib-XXXXXX`; the next call that writes to the directory removes it. Safe beside other processes.
/// @throws std::runtime_error naming path and cause; the old file is untouched then
void writeFileAtomically(const std::string& path, const std::string& text);

/// Reads what formatResult() wrote. @throws std::runtime_error naming file and key
CalibrationEstimate loadResult(const std::string& path);
/// Same, from text; `path` is used in messages only.
CalibrationEstimate parseResult(const std::string& yaml, const std::string& path);

}  // namespace cocalib
