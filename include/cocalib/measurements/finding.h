#pragma once

#include <string>

namespace cocalib {

/// Something about the input that the user can put right.
struct Finding {
  enum class Weight { kNote, kWarning, kError };  ///< kError: no good calibration can come of it

  std::string check;    ///< which check found it, a name that stays: "imu units"
  std::string problem;  ///< what is seen, with figures
  std::string remedy;   ///< what to do about it
  Weight weight = Weight::kWarning;

  /// One line for people.
  std::string words() const { return remedy.empty() ? problem : problem + "; " + remedy; }
};

}  // namespace cocalib
