// jpeg and png with broken bytes.

#include "cocalib/ros/image_reader.h"
#include "expect.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  sensor_msgs::CompressedImage msg;
  msg.header.stamp.sec = 1;
  msg.format = "jpeg";
  msg.data.assign(data, data + count);
  std::string problem;
  const auto frame = cocalib::readImage(msg, &problem);
  if (frame) {
    EXPECT_ALWAYS(frame->gray.type() == CV_8UC1 && !frame->gray.empty());
  } else {
    expectOneLine(problem);
  }
  return 0;
}
