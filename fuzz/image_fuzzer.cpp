// Raw pictures with any sizes, step, encoding and bytes.

#include <fuzzer/FuzzedDataProvider.h>

#include "cocalib/ros/image_reader.h"
#include "expect.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  static const char* const kEncodings[] = {"mono8",       "mono16",      "rgb8",         "bgr8",  "rgba8",  "bgra8",
                                           "bayer_rggb8", "yuv422",      "bayer_gbrg16", "16UC1", "8UC1",   "rgb16",
                                           "32FC1",       "yuv422_yuy2", "bayer_bggr8",  "8UC3",  "bgra16", "8SC1"};
  FuzzedDataProvider bytes(data, count);
  const auto size = [&bytes] {
    return bytes.ConsumeBool() ? bytes.ConsumeIntegralInRange<std::uint32_t>(0, 32)
                               : bytes.ConsumeIntegral<std::uint32_t>();
  };
  sensor_msgs::Image msg;
  msg.header.stamp.sec = bytes.ConsumeIntegral<std::uint32_t>();
  msg.encoding = bytes.ConsumeIntegralInRange(0, 15) == 0 ? bytes.ConsumeRandomLengthString(12)
                                                          : std::string(bytes.PickValueInArray(kEncodings));
  msg.width = size();
  msg.height = size();
  msg.step = size();
  msg.is_bigendian = bytes.ConsumeBool();
  msg.data = bytes.ConsumeRemainingBytes<std::uint8_t>();
  std::string problem;
  const auto frame = cocalib::readImage(msg, &problem);
  if (!frame) {
    expectOneLine(problem);
    return 0;
  }
  EXPECT_ALWAYS(frame->gray.type() == CV_8UC1);
  EXPECT_ALWAYS(frame->gray.cols == static_cast<int>(msg.width) && frame->gray.rows == static_cast<int>(msg.height));
  return 0;
}
