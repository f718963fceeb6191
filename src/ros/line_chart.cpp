#include "cocalib/ros/line_chart.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace cocalib {
namespace {

constexpr double kBandOpacity = 0.18;
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kFontScale = 0.4;
constexpr int kLeft = 58, kRight = 14, kTop = 40, kBottom = 24;  // px around a chart's area; two lines of text above it
const cv::Scalar kInk(60, 60, 60), kGrid(225, 225, 225), kWantedInk(150, 60, 150), kReachedInk(40, 120, 30);
const std::array<cv::Scalar, 3> kColours = {cv::Scalar(40, 40, 210), cv::Scalar(40, 140, 30), cv::Scalar(210, 90, 30)};

/// Data to pixels of one panel.
struct Axes {
  cv::Rect area;
  double x_max = 1.0, y_max = 1.0;  // x from 0, y symmetric about 0

  cv::Point at(double x, double y) const {
    // Far outside is clamped: cv::line takes shorts times a fixed-point factor.
    const double px = area.x + std::clamp(x / x_max, -1.0, 2.0) * area.width;
    const double py = area.y + 0.5 * (1.0 - std::clamp(y / y_max, -4.0, 4.0)) * area.height;
    return {static_cast<int>(std::lround(px)), static_cast<int>(std::lround(py))};
  }
};

/// 1, 2 or 5 times a power of ten, at least `value`.
double roundUp(double value) {
  const double base = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * base >= value * (1.0 - 1e-9)) return factor * base;
  }
  return 10.0 * base;
}

Axes fitAxes(const std::vector<Curve>& curves, const cv::Rect& area) {
  Axes axes;
  axes.area = area;
  double x_max = 0.0, y_max = 0.0;
  for (const Curve& curve : curves) {
    if (!curve.points.empty()) x_max = std::max(x_max, curve.points.back().x);
  }
  for (const Curve& curve : curves) {
    for (const Curve::Point& point : curve.points) {
      if (point.x >= x_max / 3.0) y_max = std::max(y_max, std::abs(point.y) + point.sigma);
    }
  }
  axes.x_max = x_max > 0.0 ? x_max : 1.0;
  axes.y_max = roundUp(std::max(y_max, 1e-4));
  return axes;
}

/// @param digits  significant ones
std::string format(double value, int digits) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.*g", digits, value);
  return text;
}

void write(const std::string& text, const cv::Point& at, const cv::Scalar& colour, cv::Mat* panel) {
  cv::putText(*panel, text, at, kFont, kFontScale, colour, 1, cv::LINE_AA);
}

/// Names and newest sigmas of all curves in the second line above the area.
void writeLegend(const std::vector<Curve>& curves, const Axes& axes, cv::Mat* panel) {
  int x = axes.area.x;
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (curves[i].points.empty()) continue;
    const std::string name = curves[i].name.empty() ? "" : curves[i].name + " ";
    const std::string text = name + "+-" + format(curves[i].points.back().sigma, 2);
    write(text, {x, axes.area.y - 7}, kColours[i % kColours.size()], panel);
    x += cv::getTextSize(text, kFont, kFontScale, 1, nullptr).width + 12;
  }
}

bool isReached(double wanted_sigma, const std::vector<Curve>& curves) {
  return std::all_of(curves.begin(), curves.end(), [wanted_sigma](const Curve& curve) {
    return !curve.points.empty() && curve.points.back().sigma <= wanted_sigma;
  });
}

/// The sigma that is wanted in words, and as dashed lines as far as the range shows it.
void drawWanted(const ChartLabels& labels, const std::vector<Curve>& curves, const Axes& axes, cv::Mat* panel) {
  if (labels.wanted_sigma <= 0.0) return;
  const bool reached = isReached(labels.wanted_sigma, curves);
  const std::string text = "wanted +-" + format(labels.wanted_sigma, 3) + (reached ? ", reached" : "");
  const int width = cv::getTextSize(text, kFont, kFontScale, 1, nullptr).width;
  write(text, {axes.area.x + axes.area.width - width, axes.area.y - 23}, reached ? kReachedInk : kWantedInk, panel);
  if (labels.wanted_sigma > axes.y_max) return;
  constexpr int kDash = 6;
  for (const double y : {-labels.wanted_sigma, labels.wanted_sigma}) {
    const cv::Point left = axes.at(0.0, y);
    for (int x = 0; x < axes.area.width; x += 2 * kDash) {
      cv::line(*panel, {left.x + x, left.y}, {left.x + std::min(x + kDash, axes.area.width), left.y}, kWantedInk);
    }
  }
}

void drawFrame(const std::string& title, const Axes& axes, cv::Mat* panel) {
  for (const double part : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
    const cv::Point left = axes.at(0.0, part * axes.y_max);
    cv::line(*panel, left, {left.x + axes.area.width, left.y}, part == 0.0 ? cv::Scalar::all(150) : kGrid);
    const std::string label = format(part * axes.y_max, 3);
    const int width = cv::getTextSize(label, kFont, kFontScale, 1, nullptr).width;
    write(label, {axes.area.x - width - 4, left.y + 4}, kInk, panel);
  }
  const double step = roundUp(axes.x_max / 6.0);
  for (int i = 0; i * step <= axes.x_max; ++i) {
    const cv::Point top = axes.at(i * step, axes.y_max);
    cv::line(*panel, top, {top.x, axes.area.y + axes.area.height}, kGrid);
    write(format(i * step, 4) + " s", {std::min(top.x, panel->cols - 34), axes.area.y + axes.area.height + 15}, kInk,
          panel);
  }
  cv::rectangle(*panel, axes.area, cv::Scalar::all(120));
  write(title, {axes.area.x, axes.area.y - 23}, cv::Scalar::all(0), panel);
}

void fillBand(const Curve& curve, const Axes& axes, const cv::Scalar& colour, cv::Mat* panel) {
  std::vector<cv::Point> outline;
  for (const Curve::Point& point : curve.points) outline.push_back(axes.at(point.x, point.y + point.sigma));
  for (auto point = curve.points.rbegin(); point != curve.points.rend(); ++point) {
    outline.push_back(axes.at(point->x, point->y - point->sigma));
  }
  cv::Mat filled = panel->clone();
  cv::fillPoly(filled, std::vector<std::vector<cv::Point>>{outline}, colour);
  cv::addWeighted(filled, kBandOpacity, *panel, 1.0 - kBandOpacity, 0.0, *panel);
}

void drawCurve(const Curve& curve, const Axes& axes, const cv::Scalar& colour, cv::Mat* panel) {
  for (std::size_t i = 0; i < curve.points.size(); ++i) {
    const cv::Point here = axes.at(curve.points[i].x, curve.points[i].y);
    cv::circle(*panel, here, 2, colour, cv::FILLED, cv::LINE_AA);
    if (i == 0) continue;
    cv::line(*panel, axes.at(curve.points[i - 1].x, curve.points[i - 1].y), here, colour, 1, cv::LINE_AA);
  }
}

}  // namespace

void drawChart(const ChartLabels& labels, const std::vector<Curve>& curves, cv::Mat* panel) {
  const cv::Rect area(kLeft, kTop, panel->cols - kLeft - kRight, panel->rows - kTop - kBottom);
  const Axes axes = fitAxes(curves, area);
  cv::Mat inside = *panel;
  drawFrame(labels.title + " [" + labels.unit + "]", axes, panel);
  // Curves may leave the area: draw on a copy, take back only the area.
  cv::Mat drawn = panel->clone();
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (curves[i].points.size() > 1) fillBand(curves[i], axes, kColours[i % kColours.size()], &drawn);
  }
  for (std::size_t i = 0; i < curves.size(); ++i) drawCurve(curves[i], axes, kColours[i % kColours.size()], &drawn);
  drawn(area).copyTo(inside(area));
  drawWanted(labels, curves, axes, panel);
  writeLegend(curves, axes, panel);
}

void drawCaption(const std::string& text, cv::Mat* image) {
  constexpr double kScale = 0.6;
  const cv::Size size = cv::getTextSize(text, kFont, kScale, 1, nullptr);
  cv::putText(*image, text, {(image->cols - size.width) / 2, (image->rows + size.height) / 2}, kFont, kScale, kInk, 1,
              cv::LINE_AA);
}

void drawHeading(const std::string& word, const cv::Scalar& colour, const std::string& text, cv::Mat* strip) {
  const int baseline = (strip->rows + 11) / 2;
  const int width = cv::getTextSize(word, kFont, 0.5, 1, nullptr).width;
  cv::rectangle(*strip, cv::Rect(8, baseline - 15, width + 12, 20), colour, cv::FILLED);
  cv::putText(*strip, word, {14, baseline}, kFont, 0.5, cv::Scalar::all(255), 1, cv::LINE_AA);
  cv::putText(*strip, text, {width + 28, baseline}, kFont, kFontScale, kInk, 1, cv::LINE_AA);
}

}  // namespace cocalib
