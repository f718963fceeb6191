#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace cocalib::test {

/// Header stamp of the clouds below: a date, with nanoseconds that a double in seconds does not hold.
const ros::Time kStamp(1600000000, 123456789);
constexpr double kPeriod_s = 0.1;
constexpr double kPi = 3.14159265358979323846;

/// One firing of a VLP-16 that turns clockwise once in 0.1 s, in a round room.
struct Return {
  Eigen::Vector3f p;
  double time_s;  // since the first firing
  int ring;
};

/// A whole turn: `firings` firings of 16 lasers, in firing order, starting at azimuth `start_rad`.
inline std::vector<Return> makeSweep(int firings = 900, double start_rad = -1.0, double direction = -1.0) {
  static const int kLaserOrder[16] = {0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> range(3.0, 30.0);
  std::vector<Return> sweep;
  for (int firing = 0; firing < firings; ++firing) {
    for (int slot = 0; slot < 16; ++slot) {
      const double time_s = (firing + slot / 24.0) * kPeriod_s / firings;
      const double azimuth = start_rad + direction * 2.0 * kPi * time_s / kPeriod_s;
      const double elevation = (-15.0 + 2.0 * kLaserOrder[slot]) * kPi / 180.0;
      const double r = range(random);
      sweep.push_back({Eigen::Vector3d(r * std::cos(elevation) * std::cos(azimuth),
                                       r * std::cos(elevation) * std::sin(azimuth), r * std::sin(elevation))
                           .cast<float>(),
                       time_s, kLaserOrder[slot]});
    }
  }
  return sweep;
}

/// Puts a PointCloud2 together byte by byte, as drivers do.
class CloudBuilder {
 public:
  CloudBuilder() {
    msg_.header.stamp = kStamp;
    msg_.height = 1;
    for (const char* name : {"x", "y", "z"}) field(name, sensor_msgs::PointField::FLOAT32);
  }

  CloudBuilder& field(const std::string& name, std::uint8_t datatype) {
    sensor_msgs::PointField f;
    f.name = name;
    f.offset = msg_.point_step;
    f.datatype = datatype;
    f.count = 1;
    msg_.fields.push_back(f);
    static const std::uint32_t kSizes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};
    msg_.point_step += kSizes[datatype];
    return *this;
  }
  CloudBuilder& padding(std::uint32_t bytes) {
    msg_.point_step += bytes;
    return *this;
  }

  /// Appends a point; `values` are those of the fields after x, y, z.
  CloudBuilder& point(const Eigen::Vector3f& p, const std::vector<double>& values = {}) {
    const std::size_t begin = msg_.data.size();
    msg_.data.resize(begin + msg_.point_step, 0xAA);
    for (std::size_t i = 0; i < msg_.fields.size(); ++i) {
      const double value = i < 3 ? static_cast<double>(p[static_cast<int>(i)]) : values.at(i - 3);
      store(msg_.fields[i].datatype, value, &msg_.data[begin + msg_.fields[i].offset]);
    }
    ++msg_.width;
    msg_.row_step = msg_.width * msg_.point_step;
    return *this;
  }

  sensor_msgs::PointCloud2 build() const { return msg_; }

 private:
  template <typename T>
  static void storeAs(double value, std::uint8_t* bytes) {
    const T typed = static_cast<T>(value);
    std::memcpy(bytes, &typed, sizeof(typed));
  }
  static void store(std::uint8_t datatype, double value, std::uint8_t* bytes) {
    using F = sensor_msgs::PointField;
    switch (datatype) {
      case F::UINT8:
        return storeAs<std::uint8_t>(value, bytes);
      case F::UINT16:
        return storeAs<std::uint16_t>(value, bytes);
      case F::UINT32:
        return storeAs<std::uint32_t>(value, bytes);
      case F::INT32:
        return storeAs<std::int32_t>(value, bytes);
      case F::FLOAT32:
        return storeAs<float>(value, bytes);
      default:
        return storeAs<double>(value, bytes);
    }
  }

  sensor_msgs::PointCloud2 msg_;
};

}  // namespace cocalib::test
