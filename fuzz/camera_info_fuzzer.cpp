// CameraInfo with any numbers; what is accepted must be a camera that projects.

#include <fuzzer/FuzzedDataProvider.h>

#include <cmath>
#include <cstring>

#include "cocalib/ros/camera_info.h"
#include "expect.h"

namespace {

double number(FuzzedDataProvider* bytes) {
  switch (bytes->ConsumeIntegralInRange(0, 2)) {
    case 0:
      return 0.0;
    case 1:
      return bytes->ConsumeFloatingPointInRange(-1000.0, 1000.0);
    default: {
      const auto bits = bytes->ConsumeIntegral<std::uint64_t>();  // NaN and infinity too
      double value;
      std::memcpy(&value, &bits, sizeof(value));
      return value;
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  static const char* const kModels[] = {"plumb_bob", "rational_polynomial", "equidistant", "fisheye", "", "unknown"};
  FuzzedDataProvider bytes(data, count);
  const auto size = [&bytes] {
    return bytes.ConsumeBool() ? bytes.ConsumeIntegralInRange<std::uint32_t>(0, 2000)
                               : bytes.ConsumeIntegral<std::uint32_t>();
  };
  sensor_msgs::CameraInfo msg;
  msg.width = size();
  msg.height = size();
  msg.distortion_model = bytes.PickValueInArray(kModels);
  for (double& k : msg.K) k = number(&bytes);
  msg.D.resize(bytes.ConsumeIntegralInRange<std::size_t>(0, 15));
  for (double& d : msg.D) d = number(&bytes);
  if (bytes.ConsumeBool()) {
    msg.binning_x = size();
    msg.binning_y = size();
    msg.roi.x_offset = size();
    msg.roi.y_offset = size();
    msg.roi.width = size();
    msg.roi.height = size();
  }
  std::string problem;
  const auto camera = cocalib::readCameraInfo(msg, &problem);
  if (!camera) {
    expectOneLine(problem);
    return 0;
  }
  EXPECT_ALWAYS(camera->width() > 0 && camera->height() > 0);
  const auto px = camera->project({0.1, -0.2, 1.0});
  EXPECT_ALWAYS(!px || px->allFinite());
  return 0;
}
