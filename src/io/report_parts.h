#pragma once

#include <string>
#include <vector>

#include "cocalib/io/report.h"

// Sections of report.html; each is a piece of HTML, empty where there is nothing to say.
namespace cocalib {

/// Text as HTML shows it, whatever it holds.
std::string escapeHtml(const std::string& text);
/// printf into a string.
__attribute__((format(printf, 1, 2))) std::string formatText(const char* pattern, ...);

std::string reportSummary(const RigConfig& rig, const CalibrationEstimate& estimate);
/// Both directions of all transforms, with sigmas.
std::string reportTransforms(const RigConfig& rig, const CalibrationEstimate& estimate);
std::string reportCorrelation(const CalibrationEstimate& estimate);
std::string reportFindings(const std::vector<Finding>& findings);
std::string reportResiduals(const ResidualSamples& residuals);
std::string reportCoverage(const MotionCoverage& motion, const BoardCoverage& board);
std::string reportPictures(const std::vector<ReportPicture>& pictures);

}  // namespace cocalib
