#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace cocalib {

/// Counters and words that a calibrator gives to /diagnostics and to the console. Copies are cheap enough for 1 Hz.
struct CalibratorDiagnostics {
  std::string stage;     ///< "waiting for imu" | "waiting for motion" | "rotation found" | "refining" | ...
  std::string message;   ///< what it waits for, in words for the user
  std::string progress;  ///< the state in one line; empty where nobody watches
  std::vector<std::string> findings;            ///< what is wrong with the input, each with what to do about it
  std::map<std::string, std::uint64_t> counts;  ///< e.g. "images", "images without board", "scans refused"
};

}  // namespace cocalib
