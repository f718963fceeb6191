#include "cocalib/ros/image_reader.h"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cstdint>
#include <exception>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

namespace encodings = sensor_msgs::image_encodings;

constexpr std::uint32_t kLargestSide = 65536;               // [px]
constexpr std::uint64_t kLargestPixelCount = 200'000'000U;  // decoded from a few bytes of jpeg or png

std::nullopt_t refuse(std::string why, std::string* problem) {
  std::replace(why.begin(), why.end(), '\n', ' ');  // OpenCV's own texts have several lines
  if (problem != nullptr) *problem = std::move(why);
  return std::nullopt;
}

bool isKnown(const std::string& encoding) {
  return encodings::isMono(encoding) || encodings::isColor(encoding) || encodings::isBayer(encoding) ||
         encoding == "8UC1" || encoding == "16UC1" || encoding == encodings::YUV422;
}

/// Reads width and height from the header of a png or jpeg, so that nothing is decoded into memory that a few lying
/// bytes ask for.
/// @return false if the header is neither, or is cut short
bool readSize(const std::vector<std::uint8_t>& data, std::uint32_t* width, std::uint32_t* height) {
  const auto big16 = [&data](std::size_t i) { return std::uint32_t{data[i]} << 8U | data[i + 1]; };
  if (data.size() >= 24 && data[0] == 0x89 && data[1] == 'P' && data[2] == 'N' && data[3] == 'G') {
    *width = big16(16) << 16U | big16(18);
    *height = big16(20) << 16U | big16(22);
    return true;
  }
  if (data.size() < 4 || data[0] != 0xFF || data[1] != 0xD8) return false;
  for (std::size_t i = 2; i + 9 < data.size();) {  // jpeg: one segment after the other until the frame header
    if (data[i] != 0xFF) return false;
    const std::uint8_t marker = data[i + 1];
    if (marker == 0xFF) {  // fill byte
      ++i;
      continue;
    }
    const bool frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) {
      *height = big16(i + 5);
      *width = big16(i + 7);
      return true;
    }
    i += 2 + big16(i + 2);
  }
  return false;
}

// The picture as the sensor has it: the camera model knows nothing of an EXIF orientation.
constexpr int kDecodeFlags = cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION;

/// Whether a jpeg has its end mark; decoders paint what is missing grey and say nothing.
bool endsProperly(const std::vector<std::uint8_t>& data) {
  if (data[0] == 0x89) return true;  // png: its decoder refuses
  static constexpr std::uint8_t kEndOfImage[] = {0xFF, 0xD9};
  const auto end = std::find_end(data.begin(), data.end(), std::begin(kEndOfImage), std::end(kEndOfImage));
  return end != data.end();
}

/// 8-bit grey from what cv::imdecode() gives with kDecodeFlags.
cv::Mat toGray8(const cv::Mat& decoded) {
  if (decoded.depth() == CV_8U) return decoded;
  cv::Mat gray;
  decoded.convertTo(gray, CV_8U, 1.0 / 256.0);
  return gray;
}

/// The picture with its 16-bit numbers the other way round; cv_bridge leaves them as pairs of bytes.
sensor_msgs::Image toLittleEndian(sensor_msgs::Image msg) {
  for (std::size_t i = 0; i + 1 < msg.data.size(); i += 2) std::swap(msg.data[i], msg.data[i + 1]);
  msg.is_bigendian = 0;
  return msg;
}

}  // namespace

std::optional<ImageFrame> readImage(const sensor_msgs::Image& msg, std::string* problem) {
  if (msg.header.stamp.isZero()) return refuse("picture has no stamp", problem);
  if (msg.width == 0 || msg.height == 0 || msg.width > kLargestSide || msg.height > kLargestSide) {
    return refuse("picture of " + std::to_string(msg.width) + " x " + std::to_string(msg.height) + " is impossible",
                  problem);
  }
  if (!isKnown(msg.encoding)) return refuse("picture encoding '" + msg.encoding + "' is not known", problem);
  try {
    const std::uint64_t bytes_per_pixel =
        static_cast<std::uint64_t>(encodings::numChannels(msg.encoding) * encodings::bitDepth(msg.encoding) / 8);
    if (msg.step < msg.width * bytes_per_pixel || msg.data.size() < std::uint64_t{msg.step} * msg.height) {
      return refuse("picture claims " + std::to_string(msg.height) + " rows of " + std::to_string(msg.step) +
                        " bytes and has " + std::to_string(msg.data.size()),
                    problem);
    }
    if (msg.is_bigendian != 0 && encodings::bitDepth(msg.encoding) == 16) {
      if (msg.step % 2 != 0)
        return refuse("picture of 16 bits has rows of " + std::to_string(msg.step) + " bytes", problem);
      return readImage(toLittleEndian(msg), problem);
    }
    ImageFrame frame;
    frame.stamp = toTimeNs(msg.header.stamp);
    if (msg.encoding == "8UC1" || msg.encoding == encodings::MONO8) {
      const cv::Mat view(static_cast<int>(msg.height), static_cast<int>(msg.width), CV_8UC1,
                         const_cast<std::uint8_t*>(msg.data.data()), msg.step);
      frame.gray = view.clone();
    } else if (msg.encoding == "16UC1") {
      frame.gray = toGray8(cv_bridge::toCvCopy(msg)->image);
    } else {
      frame.gray = cv_bridge::toCvCopy(msg, encodings::MONO8)->image;
    }
    return frame;
  } catch (const std::exception& error) {  // cv_bridge and OpenCV throw types of their own, all derived from it
    return refuse(std::string("picture cannot be read: ") + error.what(), problem);
  }
}

std::optional<ImageFrame> readImage(const sensor_msgs::CompressedImage& msg, std::string* problem) {
  if (msg.header.stamp.isZero()) return refuse("picture has no stamp", problem);
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  if (!readSize(msg.data, &width, &height)) {
    return refuse("compressed picture is neither jpeg nor png (it says '" + msg.format + "', " +
                      std::to_string(msg.data.size()) + " bytes)",
                  problem);
  }
  if (width == 0 || height == 0 || width > kLargestSide || height > kLargestSide ||
      std::uint64_t{width} * height > kLargestPixelCount) {
    return refuse("compressed picture of " + std::to_string(width) + " x " + std::to_string(height) + " is impossible",
                  problem);
  }
  if (!endsProperly(msg.data)) return refuse("compressed picture is cut short", problem);
  try {
    const cv::Mat decoded = cv::imdecode(msg.data, kDecodeFlags);
    if (decoded.empty()) return refuse("compressed picture is damaged", problem);
    ImageFrame frame;
    frame.stamp = toTimeNs(msg.header.stamp);
    frame.gray = toGray8(decoded);
    return frame;
  } catch (const std::exception& error) {
    return refuse(std::string("compressed picture cannot be read: ") + error.what(), problem);
  }
}

}  // namespace cocalib
