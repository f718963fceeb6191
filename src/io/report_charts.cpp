#include <algorithm>
#include <cmath>

#include "report_parts.h"

namespace cocalib {
namespace {

constexpr int kBins = 41;
constexpr double kReachSigmas = 5.0;
constexpr int kWidth = 480, kHeight = 190, kLeft = 10, kTop = 8, kBottom = 24;

double rmsOf(const std::vector<float>& samples) {
  double square = 0.0;
  for (const float sample : samples) square += static_cast<double>(sample) * sample;
  return samples.empty() ? 0.0 : std::sqrt(square / static_cast<double>(samples.size()));
}

/// Residuals as bars, what was assumed of them as a line. @param scale  from samples to what is printed
std::string histogram(const std::string& title, const std::vector<float>& samples, double sigma, double scale,
                      const char* unit) {
  if (samples.empty() || !(sigma > 0.0)) return "";
  std::vector<double> bins(kBins, 0.0);
  std::size_t outside = 0;
  for (const float sample : samples) {
    const double place = (sample / sigma + kReachSigmas) / (2.0 * kReachSigmas) * kBins;
    if (!(place >= 0.0 && place < kBins)) {
      ++outside;
      continue;
    }
    bins[static_cast<std::size_t>(place)] += 1.0;
  }
  const double bin_sigmas = 2.0 * kReachSigmas / kBins;
  const double peak = static_cast<double>(samples.size()) * bin_sigmas / std::sqrt(2.0 * M_PI);
  const double highest = std::max(peak, *std::max_element(bins.begin(), bins.end()));
  const double area_width = kWidth - 2.0 * kLeft, area_height = kHeight - kTop - kBottom;
  const auto y = [&](double count) { return kTop + area_height * (1.0 - count / highest); };
  std::string svg = formatText("<svg viewBox=\"0 0 %d %d\" width=\"%d\">", kWidth, kHeight, kWidth);
  for (int i = 0; i < kBins; ++i) {
    const double count = bins[static_cast<std::size_t>(i)];
    svg +=
        formatText("<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"#8fb3d9\"/>",
                   kLeft + area_width * i / kBins, y(count), area_width / kBins - 1.0, kTop + area_height - y(count));
  }
  svg += "<polyline fill=\"none\" stroke=\"#c0392b\" stroke-width=\"2\" points=\"";
  for (int i = 0; i <= 100; ++i) {
    const double s = kReachSigmas * (i / 50.0 - 1.0);
    svg += formatText("%.1f,%.1f ", kLeft + area_width * i / 100.0, y(peak * std::exp(-0.5 * s * s)));
  }
  svg += "\"/>";
  for (int tick = -4; tick <= 4; tick += 2) {
    svg += formatText("<text x=\"%.1f\" y=\"%d\" font-size=\"12\" text-anchor=\"middle\">%.3g</text>",
                      kLeft + area_width * (tick / (2.0 * kReachSigmas) + 0.5), kHeight - 6, tick * sigma * scale);
  }
  return "<figure><figcaption>" + escapeHtml(title) +
         formatText(" [%s]: rms %.3g, assumed %.3g (line); %.2f %% lie outside</figcaption>", unit,
                    rmsOf(samples) * scale, sigma * scale, 100.0 * static_cast<double>(outside) / samples.size()) +
         svg + "</svg></figure>\n";
}

}  // namespace

std::string reportResiduals(const ResidualSamples& residuals) {
  const std::string charts =
      histogram("IMU, between neighbouring states", residuals.imu_sigmas, 1.0, 1.0, "sigmas") +
      histogram("Chessboard corners", residuals.corners_px, residuals.corner_sigma_px, 1.0, "px") +
      histogram("Natural features", residuals.tracks_px, residuals.track_sigma_px, 1.0, "px") +
      histogram("Lidar points to their planes", residuals.planes_m, residuals.plane_sigma_m, 1e3, "mm");
  if (charts.empty()) return "";
  return "<h2>Residuals against the assumed noise</h2>\n<p>Bars wider than the line: the sensor is noisier than the "
         "rig file "
         "says, or something is not modelled.</p>\n<div class=\"pair\">\n" +
         charts + "</div>\n";
}

std::string reportCoverage(const MotionCoverage& motion, const BoardCoverage& board) {
  constexpr double kDeg = 180.0 / M_PI;
  std::string text =
      "<h2>Coverage</h2>\n<table>\n<tr><th class=\"left\">axis of the IMU</th><th>turned, back and forth [deg]</th>"
      "<th>rate, rms [deg/s]</th><th>shaken, rms [m/s&sup2;]</th></tr>\n";
  const Eigen::Vector3d turned = kDeg * motion.turned_rad(), rate = kDeg * motion.rms_rad_s(),
                        shaken = motion.shaken_m_s2();
  const double most = std::max(1.0, turned.maxCoeff());
  for (int i = 0; i < 3; ++i) {
    text += formatText(
        "<tr><td class=\"left\">%c</td><td>%.0f <svg width=\"160\" height=\"12\"><rect width=\"%.0f\" height=\"12\" "
        "fill=\"#8fb3d9\"/></svg></td><td>%.1f</td><td>%.2f</td></tr>\n",
        "xyz"[i], turned[i], 160.0 * turned[i] / most, rate[i], shaken[i]);
  }
  text += "</table>\n";
  if (board.pictures() == 0) return text;
  text += formatText("<p>The board was found in %d of %d pictures; its corners covered %.0f %% of the picture:</p>\n",
                     board.views(), board.pictures(), 100.0 * board.coveredShare());
  int highest = 1;
  for (const auto& row : board.corners()) highest = std::max(highest, *std::max_element(row.begin(), row.end()));
  constexpr int kCell = 22;
  text += formatText("<svg width=\"%d\" height=\"%d\" style=\"border:1px solid #999\">",
                     kCell * BoardCoverage::kColumns, kCell * BoardCoverage::kRows);
  for (int r = 0; r < BoardCoverage::kRows; ++r) {
    for (int c = 0; c < BoardCoverage::kColumns; ++c) {
      const int count = board.corners()[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
      if (count == 0) continue;
      text +=
          formatText("<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" fill=\"rgba(40,110,60,%.2f)\"/>", kCell * c,
                     kCell * r, kCell, kCell, 0.15 + 0.85 * std::sqrt(static_cast<double>(count) / highest));
    }
  }
  return text + "</svg>\n";
}

}  // namespace cocalib
