#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace cocalib {

/// One number of every point: where it stands and of what type it is.
struct PointFieldAccess {
  std::string name;
  std::size_t offset = 0;     ///< bytes from the start of the point
  std::uint8_t datatype = 0;  ///< sensor_msgs::PointField's constant

  /// The number as a double (exact but for 64-bit integers, which PointCloud2 does not have).
  /// @pre the point's bytes have been checked to reach up to offset + size of the type
  double read(const std::uint8_t* point) const;
};

/// Where the numbers that matter stand in a point.
struct PointLayout {
  std::size_t x = 0, y = 0, z = 0;  ///< float32 each
  std::optional<PointFieldAccess> time, ring;

  std::vector<sensor_msgs::PointField> fields;  ///< what the layout was made from
  std::uint32_t point_step = 0;

  /// Whether the layout still holds for this message.
  bool fits(const sensor_msgs::PointCloud2& msg) const;
};

/// "float32" and so on; "type 42" for what PointField does not know.
std::string pointTypeName(std::uint8_t datatype);

/// Finds the fields: x, y, z; the time under the names that drivers use, or under `time_field` where it is not empty
/// ("none": there is none); the ring. All of them are checked to lie inside a point.
/// @return nothing, and one line in `problem`, if the cloud cannot be read
std::optional<PointLayout> findPointLayout(const sensor_msgs::PointCloud2& msg, const std::string& time_field,
                                           std::string* problem);

/// Whether width, height, steps and the length of the data agree; one line in `problem` if not.
bool checkCloudSize(const sensor_msgs::PointCloud2& msg, std::string* problem);

}  // namespace cocalib
