#pragma once

#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/residual_samples.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/measurements/finding.h"
#include "cocalib/monitor/coverage.h"

namespace cocalib {

/// A picture of the report, encoded.
struct ReportPicture {
  std::string title;
  std::string media_type;  ///< "image/png" | "image/jpeg"
  std::string bytes;
  bool wide = false;  ///< takes a row for itself; others stand two a row
};

/// What a run has to say besides its numbers.
struct ReportContents {
  std::vector<Finding> findings;  ///< of the input doctor
  MotionCoverage motion;
  BoardCoverage board;
  ResidualSamples residuals;
  std::vector<ReportPicture> pictures;
};

/// report.html as text: one file without any link, so that it can be sent and kept. The same input gives the same
/// bytes.
std::string formatReport(const RigConfig& rig, const CalibrationEstimate& estimate, const ReportContents& contents);

/// Version of cocalib and of the libraries that it was built with, one a line.
std::string describeVersions();

}  // namespace cocalib
