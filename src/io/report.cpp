#include "cocalib/io/report.h"

#include <ceres/version.h>

#include <Eigen/Core>
#include <cstdarg>
#include <cstdio>
#include <opencv2/core/version.hpp>

#include "report_parts.h"

#ifndef COCALIB_VERSION
#error "COCALIB_VERSION is to be defined by the build"
#endif

namespace cocalib {
namespace {

constexpr const char* kStyle = R"(
body { font: 15px/1.45 sans-serif; color: #222; max-width: 1080px; margin: 24px auto; padding: 0 16px; }
h1 { font-size: 26px; margin: 0 0 8px; } h2 { font-size: 19px; margin: 34px 0 8px; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; margin: 8px 0; } td, th { padding: 3px 10px; text-align: right; vertical-align: top; }
th { background: #f0f2f5; font-weight: 600; } td.left, th.left { text-align: left; }
tr + tr td { border-top: 1px solid #e4e4e4; } td, pre { font-variant-numeric: tabular-nums; }
.status { display: inline-block; padding: 3px 12px; border-radius: 4px; color: #fff; font-weight: 600; }
.converged { background: #2b7d3c; } .converging { background: #b06f00; }
.unobservable, .insufficient_data { background: #b3261e; }
.error { color: #b3261e; font-weight: 600; } .warning { color: #8a5a00; font-weight: 600; } .note { color: #44617b; }
.small td, .small th { font-size: 11px; padding: 2px 5px; } pre { background: #f6f6f6; padding: 10px; overflow-x: auto; }
img { max-width: 100%; display: block; } figure { margin: 10px 0; } figcaption { color: #555; margin: 2px 0; }
.pair { display: flex; flex-wrap: wrap; gap: 12px; } .pair figure { flex: 1 1 480px; } .pair figure.wide { flex: 1 1 100%; } svg { background: #fff; }
)";

std::string base64(const std::string& bytes) {
  static const char* const kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t rest = bytes.size() - i;
    std::uint32_t bits = static_cast<unsigned char>(bytes[i]) << 16U;
    if (rest > 1) bits |= static_cast<unsigned char>(bytes[i + 1]) << 8U;
    if (rest > 2) bits |= static_cast<unsigned char>(bytes[i + 2]);
    text += kLetters[bits >> 18U & 63U];
    text += kLetters[bits >> 12U & 63U];
    text += rest > 1 ? kLetters[bits >> 6U & 63U] : '=';
    text += rest > 2 ? kLetters[bits & 63U] : '=';
  }
  return text;
}

}  // namespace

std::string escapeHtml(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::string formatText(const char* pattern, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(text, sizeof text, pattern, arguments);
  va_end(arguments);
  return text;
}

std::string reportPictures(const std::vector<ReportPicture>& pictures) {
  if (pictures.empty()) return "";
  std::string text =
      "<h2>Pictures</h2>\n<p>In pictures of the camera: lidar points, near ones red, far ones blue, and the outline of "
      "the "
      "board as estimated. Afterwards the points of a thing lie on it, also while the rig turns.</p>\n<div "
      "class=\"pair\">\n";
  for (const ReportPicture& picture : pictures) {
    text += std::string(picture.wide ? "<figure class=\"wide\">" : "<figure>") + "<figcaption>" +
            escapeHtml(picture.title) + "</figcaption><img alt=\"" + escapeHtml(picture.title) +
            "\" src=\"data:" + picture.media_type + ";base64," + base64(picture.bytes) + "\"></figure>\n";
  }
  return text + "</div>\n";
}

std::string describeVersions() {
  return std::string("cocalib ") + COCALIB_VERSION + "\nCeres " + CERES_VERSION_STRING +
         formatText("\nEigen %d.%d.%d\nOpenCV ", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION) +
         CV_VERSION + "\ncompiler " + __VERSION__ + "\n";
}

std::string formatReport(const RigConfig& rig, const CalibrationEstimate& estimate, const ReportContents& contents) {
  std::string text =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>cocalib report</title>\n<style>" +
      std::string(kStyle) + "</style></head><body>\n<h1>Calibration report</h1>\n";
  text += reportSummary(rig, estimate) + reportFindings(contents.findings) + reportTransforms(rig, estimate);
  text += reportCorrelation(estimate) + reportPictures(contents.pictures) + reportResiduals(contents.residuals);
  text += reportCoverage(contents.motion, rig.target ? contents.board : BoardCoverage());
  text += "<h2>Rig file</h2>\n<p>" + escapeHtml(rig.file) + "</p>\n<pre>" + escapeHtml(rig.text) + "</pre>\n";
  return text + "<h2>Versions</h2>\n<pre>" + escapeHtml(describeVersions()) + "</pre>\n</body></html>\n";
}

}  // namespace cocalib
