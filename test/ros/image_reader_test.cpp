#include "cocalib/ros/image_reader.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

const ros::Time kStamp(1600000000, 123456789);

/// A smooth grey picture, so that bayer interpolation and jpeg hardly change it.
cv::Mat makeGray() {
  cv::Mat gray(48, 64, CV_8UC1);
  for (int v = 0; v < gray.rows; ++v) {
    for (int u = 0; u < gray.cols; ++u) gray.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(40 + 2 * u + v);
  }
  return gray;
}

sensor_msgs::Image makeMessage(const cv::Mat& picture, const std::string& encoding, std::uint32_t padding = 0) {
  sensor_msgs::Image msg;
  msg.header.stamp = kStamp;
  msg.width = static_cast<std::uint32_t>(picture.cols);
  msg.height = static_cast<std::uint32_t>(picture.rows);
  msg.encoding = encoding;
  const auto row = static_cast<std::uint32_t>(picture.cols * picture.elemSize());
  msg.step = row + padding;
  for (int v = 0; v < picture.rows; ++v) {
    msg.data.insert(msg.data.end(), picture.ptr(v), picture.ptr(v) + row);
    msg.data.insert(msg.data.end(), padding, 0xEE);
  }
  return msg;
}

sensor_msgs::CompressedImage makeCompressed(const cv::Mat& picture, const std::string& extension) {
  sensor_msgs::CompressedImage msg;
  msg.header.stamp = kStamp;
  msg.format = "whatever";
  cv::imencode(extension, picture, msg.data);
  return msg;
}

template <typename Message>
void expectPicture(const Message& msg, const cv::Mat& expected, double tolerance) {
  std::string problem;
  const std::optional<ImageFrame> frame = readImage(msg, &problem);
  ASSERT_TRUE(frame) << problem;
  EXPECT_EQ(problem, "");
  EXPECT_EQ(frame->stamp, toTimeNs(kStamp));
  ASSERT_EQ(frame->gray.type(), CV_8UC1);
  ASSERT_EQ(frame->gray.size(), expected.size());
  EXPECT_LE(cv::norm(frame->gray, expected, cv::NORM_INF), tolerance);
}

TEST(ImageReader, EveryEncoding) {
  const cv::Mat gray = makeGray();
  expectPicture(makeMessage(gray, "mono8"), gray, 0);
  expectPicture(makeMessage(gray, "8UC1"), gray, 0);
  expectPicture(makeMessage(gray, "mono8", 13), gray, 0);
  cv::Mat wide;
  gray.convertTo(wide, CV_16U, 256.0);
  expectPicture(makeMessage(wide, "mono16"), gray, 1);
  expectPicture(makeMessage(wide, "16UC1"), gray, 1);
  cv::Mat colour;
  cv::cvtColor(gray, colour, cv::COLOR_GRAY2BGR);
  expectPicture(makeMessage(colour, "bgr8"), gray, 1);
  expectPicture(makeMessage(colour, "rgb8", 5), gray, 1);
  cv::cvtColor(gray, colour, cv::COLOR_GRAY2BGRA);
  expectPicture(makeMessage(colour, "bgra8"), gray, 1);
  expectPicture(makeMessage(colour, "rgba8"), gray, 1);
  // A grey scene gives the same value to every filter; at the border the interpolation has less to go by.
  for (const char* bayer : {"bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"}) {
    expectPicture(makeMessage(gray, bayer), gray, 4);
  }
}

// Grey is 0.299 R + 0.587 G + 0.114 B: exchanged channels show.
TEST(ImageReader, BigEndianPicturesAreTheSame) {
  cv::Mat wide;
  makeGray().convertTo(wide, CV_16U, 257.0);
  sensor_msgs::Image msg = makeMessage(wide, "mono16", 2);
  const auto little = readImage(msg, nullptr);
  msg.is_bigendian = 1;
  for (std::size_t i = 0; i < msg.data.size(); i += 2) std::swap(msg.data[i], msg.data[i + 1]);
  const auto big = readImage(msg, nullptr);
  ASSERT_TRUE(little && big);
  ASSERT_EQ(big->gray.type(), CV_8UC1);
  EXPECT_EQ(cv::norm(little->gray, big->gray, cv::NORM_INF), 0.0);
}

TEST(ImageReader, ChannelsAreNotExchanged) {
  const cv::Mat red_as_bgr(8, 8, CV_8UC3, cv::Scalar(0, 0, 200));
  expectPicture(makeMessage(red_as_bgr, "bgr8"), cv::Mat(8, 8, CV_8UC1, cv::Scalar(60)), 1);
  expectPicture(makeMessage(red_as_bgr, "rgb8"), cv::Mat(8, 8, CV_8UC1, cv::Scalar(23)), 1);
}

TEST(ImageReader, CompressedPictures) {
  const cv::Mat gray = makeGray();
  expectPicture(makeCompressed(gray, ".png"), gray, 0);
  expectPicture(makeCompressed(gray, ".jpg"), gray, 6);
  cv::Mat colour;
  cv::cvtColor(gray, colour, cv::COLOR_GRAY2BGR);
  expectPicture(makeCompressed(colour, ".png"), gray, 1);
  cv::Mat wide;
  gray.convertTo(wide, CV_16U, 256.0);
  expectPicture(makeCompressed(wide, ".png"), gray, 1);
}

TEST(ImageReader, ThePictureIsACopy) {
  sensor_msgs::Image msg = makeMessage(makeGray(), "mono8");
  const std::optional<ImageFrame> frame = readImage(msg, nullptr);
  std::fill(msg.data.begin(), msg.data.end(), 0);
  EXPECT_EQ(frame->gray.at<std::uint8_t>(0, 0), 40);
}

template <typename Message, typename Spoil>
std::string refusal(Message msg, const Spoil& spoil) {
  spoil(&msg);
  std::string problem;
  EXPECT_FALSE(readImage(msg, &problem));
  EXPECT_EQ(problem.find('\n'), std::string::npos) << problem;
  return problem;
}

TEST(ImageReader, SaysWhyItRefusesAPicture) {
  const sensor_msgs::Image good = makeMessage(makeGray(), "mono8");
  const auto says = [&good](const auto& spoil, const std::string& word) {
    const std::string problem = refusal(good, spoil);
    EXPECT_NE(problem.find(word), std::string::npos) << problem;
  };
  using Image = sensor_msgs::Image;
  says([](Image* m) { m->header.stamp = ros::Time(); }, "no stamp");
  says([](Image* m) { m->width = 0; }, "impossible");
  says([](Image* m) { m->height = 0xFFFFFFFF; }, "impossible");
  says([](Image* m) { m->height = 60000; }, "claims 60000 rows");
  says([](Image* m) { m->width = 65; }, "claims");
  says([](Image* m) { m->step = 0; }, "claims");
  says([](Image* m) { m->step = 0xFFFFFFFF; }, "claims");
  says([](Image* m) { m->data.pop_back(); }, "claims");
  says([](Image* m) { m->data.clear(); }, "has 0");
  says([](Image* m) { m->encoding = "rgb8"; }, "claims");
  says([](Image* m) { m->encoding = "32FC1"; }, "'32FC1' is not known");
  says([](Image* m) { m->encoding = ""; }, "not known");
}

TEST(ImageReader, SaysWhyItRefusesACompressedPicture) {
  using Image = sensor_msgs::CompressedImage;
  for (const char* extension : {".png", ".jpg"}) {
    const Image good = makeCompressed(makeGray(), extension);
    EXPECT_NE(refusal(good, [](Image* m) { m->header.stamp = ros::Time(); }), "");
    EXPECT_NE(refusal(good, [](Image* m) { m->data.clear(); }).find("neither"), std::string::npos);
    EXPECT_NE(refusal(good, [](Image* m) { m->data[0] = 'x'; }).find("neither"), std::string::npos);
    for (const std::size_t length : {std::size_t{3}, std::size_t{20}, std::size_t{100}, good.data.size() - 10}) {
      EXPECT_NE(refusal(good, [length](Image* m) { m->data.resize(length); }), "") << extension << " " << length;
    }
  }
}

// 30000 x 30000 pixels in 60 bytes: nothing may be allocated for that.
TEST(ImageReader, ALyingHeaderIsNotDecoded) {
  sensor_msgs::CompressedImage png = makeCompressed(makeGray(), ".png");
  for (const std::size_t at : {std::size_t{18}, std::size_t{22}}) {
    png.data[at] = 0x75;
    png.data[at + 1] = 0x30;
  }
  std::string problem;
  EXPECT_FALSE(readImage(png, &problem));
  EXPECT_NE(problem.find("30000 x 30000 is impossible"), std::string::npos) << problem;
}

TEST(ImageReader, SurvivesRandomDamage) {
  std::mt19937 random(4);
  for (const char* extension : {".png", ".jpg"}) {
    const sensor_msgs::CompressedImage good = makeCompressed(makeGray(), extension);
    for (int trial = 0; trial < 300; ++trial) {
      sensor_msgs::CompressedImage msg = good;
      for (int i = 0; i < 5; ++i) msg.data[random() % msg.data.size()] = static_cast<std::uint8_t>(random());
      std::string problem;
      const std::optional<ImageFrame> frame = readImage(msg, &problem);
      EXPECT_NE(frame.has_value(), !problem.empty());
    }
  }
}

}  // namespace
}  // namespace cocalib
