#include "cocalib/io/report.h"

#include <gtest/gtest.h>

#include <boost/property_tree/xml_parser.hpp>
#include <regex>
#include <sstream>

#include "cocalib/io/rig_file.h"

namespace cocalib {
namespace {

constexpr const char* kRig = R"(# <our> robot & its sensors
imu: {topic: /imu/data, gyroscope_noise_density: 1.7e-4, gyroscope_random_walk: 1.0e-6,
      accelerometer_noise_density: 5.9e-4, accelerometer_random_walk: 1.0e-5}
camera: {topic: /camera/image_raw, info_topic: /camera/camera_info}
lidar: {topic: /points, range_noise: 0.03}
target: {type: checkerboard, cols: 8, rows: 6, square: 0.10}
)";

CalibrationEstimate someEstimate() {
  CalibrationEstimate estimate;
  estimate.status = Status::kUnobservable;
  estimate.duration_s = 61.5;
  estimate.camera.valid = estimate.lidar.valid = estimate.lidar_camera.valid = true;
  estimate.calibration.T_imu_camera = {expSo3({0.4, -1.1, 2.3}), {0.125, -0.25, 0.5}};
  estimate.calibration.T_imu_lidar = {expSo3({-1.7, 0.2, 0.9}), {0.1, 0.3, -0.25}};
  estimate.calibration.camera_time_offset_s = -0.0125;
  estimate.calibration.lidar_time_offset_s = 0.0025;
  estimate.covariance.diagonal().setConstant(1e-6);
  estimate.covariance(0, 6) = estimate.covariance(6, 0) = 0.5e-6;
  estimate.camera.unobservable = {"translation along imu z: <turn> about x or y"};
  return estimate;
}

ReportContents someContents() {
  ReportContents contents;
  contents.findings.push_back({"imu rate", "/imu/data: 31 samples & less", "raise the rate", Finding::Weight::kError});
  for (int i = 0; i < 5000; ++i) {
    const float sign = i % 2 == 0 ? 1.0F : -1.0F;
    contents.residuals.corners_px.push_back(0.2F * sign);
    contents.residuals.planes_m.push_back(0.03F * sign);
  }
  contents.residuals.corner_sigma_px = 0.1;
  contents.residuals.plane_sigma_m = 0.03;
  contents.board.setPictureSize(752, 480);
  VisualKeyframe keyframe;
  keyframe.board = BoardObservation{{{10.0F, 10.0F}, {400.0F, 200.0F}}};
  contents.board.add(keyframe);
  contents.pictures.push_back({"overlay <after>", "image/png", std::string("\x89PNG\x00\xff", 6), true});
  return contents;
}

/// Every tag closed, every reference known: what a browser would otherwise guess at.
void expectWellFormed(std::string html) {
  html = std::regex_replace(html, std::regex("<!DOCTYPE html>|<meta[^>]*>|<br>"), "");
  html = std::regex_replace(html, std::regex("(<img[^>]*)>"), "$1/>");
  html = std::regex_replace(html, std::regex("&(plusmn|sup2);"), "");
  boost::property_tree::ptree tree;
  std::istringstream in(html);
  EXPECT_NO_THROW(boost::property_tree::read_xml(in, tree)) << html;
}

TEST(Report, IsOneWellFormedFileWithoutLinks) {
  const std::string html = formatReport(parseRig(kRig, "my_rig.yaml"), someEstimate(), someContents());
  expectWellFormed(html);
  for (const char* outside : {"http:", "https:", "<link", "<script", "url(", "src=\"/", "href"}) {
    EXPECT_EQ(html.find(outside), std::string::npos) << outside;
  }
  EXPECT_EQ(html, formatReport(parseRig(kRig, "my_rig.yaml"), someEstimate(), someContents()));
}

TEST(Report, SaysWhatTheRunFound) {
  const std::string html = formatReport(parseRig(kRig, "my_rig.yaml"), someEstimate(), someContents());
  const auto has = [&html](const std::string& text) { EXPECT_NE(html.find(text), std::string::npos) << text; };
  has("class=\"status unobservable\"");
  has("after 61.5 s");
  has("&lt;turn&gt; about x or y");
  has("raise the rate");
  has("my_rig.yaml");
  has("# &lt;our&gt; robot &amp; its sensors");
  has("Ceres ");
  for (const char* name :
       {"T_imu_camera", "T_camera_imu", "T_imu_lidar", "T_lidar_imu", "T_lidar_camera", "T_camera_lidar"}) {
    has("<b>" + std::string(name) + "</b>");
  }
  has("0.12500<br>-0.25000<br>0.50000");
  has("t_imu = t_camera - 12.5000 ms");
  has("t_imu = t_lidar + 2.5000 ms");
  has("views of the board");
  has(">0.50</td>");                        // correlation of the two x
  has("rms 0.2, assumed 0.1");              // corners noisier than assumed
  has("data:image/png;base64,iVBORwD/\"");  // RFC 4648, no padding needed
  has("found in 1 of 1 pictures");
  has("<figure class=\"wide\"><figcaption>overlay &lt;after&gt;");
  EXPECT_NE(html.find("[mm]: rms 30"), std::string::npos) << "planes in millimetres";
}

TEST(Report, PicturesOfAnyLengthAreEncoded) {
  ReportContents contents;
  contents.pictures = {
      {"a", "image/png", "f", false}, {"b", "image/png", "fo", false}, {"c", "image/png", "foob", false}};
  const std::string html = formatReport(parseRig(kRig, "rig.yaml"), someEstimate(), contents);
  for (const char* encoded : {"base64,Zg==\"", "base64,Zm8=\"", "base64,Zm9vYg==\""}) {
    EXPECT_NE(html.find(encoded), std::string::npos) << encoded;
  }
}

TEST(Report, SaysNothingOfABoardThatIsNotThere) {
  std::string rig = kRig;
  rig.erase(rig.find("target"));
  ReportContents contents = someContents();
  contents.board.clear();
  contents.board.add(VisualKeyframe());
  const std::string html = formatReport(parseRig(rig, "my_rig.yaml"), someEstimate(), contents);
  for (const char* words : {"board was found", "views of the board", "points on the board"}) {
    EXPECT_EQ(html.find(words), std::string::npos) << words;
  }
}

TEST(Report, StandsWithoutAnyResult) {
  const std::string html = formatReport(parseRig(kRig, "rig.yaml"), CalibrationEstimate(), ReportContents());
  expectWellFormed(html);
  EXPECT_NE(html.find("insufficient_data"), std::string::npos);
  EXPECT_NE(html.find("Nothing wrong was found"), std::string::npos);
  EXPECT_EQ(html.find("T_imu_camera"), std::string::npos);
  EXPECT_EQ(html.find("nan"), std::string::npos);
}

}  // namespace
}  // namespace cocalib
