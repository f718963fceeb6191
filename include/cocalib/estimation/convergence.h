#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// Compares an estimate from a part of the data with one from all of it. If both covariances are true, their difference
/// has the covariance P_part - P_all (the part's new information moves the estimate by no more than it says); the same
/// test, turned round, as two disjoint parts agreeing within their covariances.
/// A difference of up to some hundredths of a millimetre is always allowed.
/// @param rows  entries of the 14 parameters that both estimate
/// @return nothing if they agree (at one false alarm in ten thousand); otherwise the parameter that differs most, in
/// words
std::optional<std::string> disagreement(const CalibrationEstimate& part, const CalibrationEstimate& all,
                                        const std::vector<int>& rows);

/// Estimates over time, thinned as they grow, so that the one at half of the data can be asked for.
class EstimateHistory {
 public:
  void add(const CalibrationEstimate& estimate);
  /// The estimate nearest to half of the newest one's duration; null if there is none at 0.3 to 0.7 of it.
  const CalibrationEstimate* half() const;
  void clear() { estimates_.clear(); }

 private:
  static constexpr std::size_t kMax = 256;
  std::vector<CalibrationEstimate> estimates_;
};

}  // namespace cocalib
