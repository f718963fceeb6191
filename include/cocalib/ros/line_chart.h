#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace cocalib {

/// One curve of a chart, with a band of one sigma to both sides.
struct Curve {
  struct Point {
    double x, y, sigma;
  };
  std::string name;
  std::vector<Point> points;  ///< in order of x
};

/// What a chart is called and measured against.
struct ChartLabels {
  std::string title;
  std::string unit;
  double wanted_sigma = 0.0;  ///< drawn as dashed lines to both sides of zero, and said when reached; 0: none
};

/// Draws curves over seconds into `panel` (BGR, any size from 200x120). The y range is that of the later two thirds:
/// what happens before the estimate has settled would flatten the rest, and leaves the picture instead.
void drawChart(const ChartLabels& labels, const std::vector<Curve>& curves, cv::Mat* panel);

/// One line of text in the middle of the picture.
void drawCaption(const std::string& text, cv::Mat* image);

/// A word on its colour, and a line of text beside it; the strip should be 24 px high.
void drawHeading(const std::string& word, const cv::Scalar& colour, const std::string& text, cv::Mat* strip);

}  // namespace cocalib
