#include "cocalib/ros/point_layout.h"

#include <array>
#include <cstring>

namespace cocalib {
namespace {

using sensor_msgs::PointField;

constexpr std::uint32_t kMaxPointStep = 4096;  // bytes; drivers use 12 to 48

// In the order of preference, where a cloud has several.
const std::array<const char*, 10> kTimeNames = {"offset_time", "time",       "t",          "timestamp",
                                                "time_offset", "timeOffset", "time_stamp", "time_offset_ns",
                                                "stamp",       "ts"};
const std::array<const char*, 6> kRingNames = {"ring", "line", "channel", "laser_id", "laser", "ring_id"};

std::size_t typeSize(std::uint8_t datatype) {
  switch (datatype) {
    case PointField::INT8:
    case PointField::UINT8:
      return 1;
    case PointField::INT16:
    case PointField::UINT16:
      return 2;
    case PointField::INT32:
    case PointField::UINT32:
    case PointField::FLOAT32:
      return 4;
    case PointField::FLOAT64:
      return 8;
    default:
      return 0;
  }
}

template <typename T>
double load(const std::uint8_t* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));  // fields are not aligned
  return static_cast<double>(value);
}

const PointField* findField(const std::vector<PointField>& fields, const std::string& name) {
  for (const PointField& field : fields) {
    if (field.name == name) return &field;
  }
  return nullptr;
}

/// First field under one of the names that can carry a time: 8 and 16 bits cannot.
const PointField* findTimeField(const std::vector<PointField>& fields) {
  for (const char* name : kTimeNames) {
    const PointField* field = findField(fields, name);
    if (field != nullptr && typeSize(field->datatype) >= 4) return field;
  }
  return nullptr;
}

/// Checks that a field lies inside the point; the message is not to be believed.
bool checkField(const PointField& field, std::uint32_t point_step, std::string* problem) {
  const std::size_t size = typeSize(field.datatype);
  if (size == 0) {
    *problem = "field '" + field.name + "' has unknown " + pointTypeName(field.datatype);
    return false;
  }
  if (field.count > 1) {
    *problem = "field '" + field.name + "' is an array of " + std::to_string(field.count);
    return false;
  }
  if (std::uint64_t{field.offset} + size > point_step) {
    *problem = "field '" + field.name + "' ends at byte " + std::to_string(std::uint64_t{field.offset} + size) +
               " of points of " + std::to_string(point_step) + " bytes";
    return false;
  }
  return true;
}

bool findCoordinate(const sensor_msgs::PointCloud2& msg, const char* name, std::size_t* offset, std::string* problem) {
  const PointField* field = findField(msg.fields, name);
  if (field == nullptr) {
    *problem = std::string("cloud has no field '") + name + "'";
    return false;
  }
  if (!checkField(*field, msg.point_step, problem)) return false;
  if (field->datatype != PointField::FLOAT32) {
    *problem = std::string("field '") + name + "' is " + pointTypeName(field->datatype) + "; float32 is needed";
    return false;
  }
  *offset = field->offset;
  return true;
}

std::optional<PointFieldAccess> access(const PointField& field) {
  return PointFieldAccess{field.name, field.offset, field.datatype};
}

}  // namespace

double PointFieldAccess::read(const std::uint8_t* point) const {
  const std::uint8_t* bytes = point + offset;
  switch (datatype) {
    case PointField::INT8:
      return load<std::int8_t>(bytes);
    case PointField::UINT8:
      return load<std::uint8_t>(bytes);
    case PointField::INT16:
      return load<std::int16_t>(bytes);
    case PointField::UINT16:
      return load<std::uint16_t>(bytes);
    case PointField::INT32:
      return load<std::int32_t>(bytes);
    case PointField::UINT32:
      return load<std::uint32_t>(bytes);
    case PointField::FLOAT32:
      return load<float>(bytes);
    default:
      return load<double>(bytes);
  }
}

bool PointLayout::fits(const sensor_msgs::PointCloud2& msg) const {
  if (msg.point_step != point_step || msg.fields.size() != fields.size()) return false;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const PointField& a = fields[i];
    const PointField& b = msg.fields[i];
    if (a.offset != b.offset || a.datatype != b.datatype || a.count != b.count || a.name != b.name) return false;
  }
  return true;
}

std::string pointTypeName(std::uint8_t datatype) {
  static const std::array<const char*, 9> kNames = {"",      "int8",   "uint8",   "int16",  "uint16",
                                                    "int32", "uint32", "float32", "float64"};
  return typeSize(datatype) == 0 ? "type " + std::to_string(datatype) : kNames[datatype];
}

std::optional<PointLayout> findPointLayout(const sensor_msgs::PointCloud2& msg, const std::string& time_field,
                                           std::string* problem) {
  PointLayout layout;
  layout.fields = msg.fields;
  layout.point_step = msg.point_step;
  if (!findCoordinate(msg, "x", &layout.x, problem) || !findCoordinate(msg, "y", &layout.y, problem) ||
      !findCoordinate(msg, "z", &layout.z, problem)) {
    return std::nullopt;
  }

  const PointField* time = time_field.empty() ? findTimeField(msg.fields) : findField(msg.fields, time_field);
  if (time_field == "none") time = nullptr;
  if (time == nullptr && !time_field.empty() && time_field != "none") {
    *problem = "cloud has no field '" + time_field + "', which the rig file names as the points' time";
    return std::nullopt;
  }
  if (time != nullptr) {
    if (!checkField(*time, msg.point_step, problem)) return std::nullopt;
    layout.time = access(*time);
  }

  for (const char* name : kRingNames) {
    const PointField* ring = findField(msg.fields, name);
    if (ring == nullptr) continue;
    if (!checkField(*ring, msg.point_step, problem)) return std::nullopt;
    layout.ring = access(*ring);
    break;
  }
  return layout;
}

bool checkCloudSize(const sensor_msgs::PointCloud2& msg, std::string* problem) {
  if (msg.is_bigendian) {
    *problem = "cloud is big-endian; only little-endian ones are read";
    return false;
  }
  if (msg.width == 0 || msg.height == 0) {
    *problem = "cloud is empty";
    return false;
  }
  if (msg.point_step == 0 || msg.point_step > kMaxPointStep) {
    *problem = "cloud claims points of " + std::to_string(msg.point_step) + " bytes";
    return false;
  }
  // All in 64 bits: each factor has 32. A single row's row_step is often left at zero, and then does not matter.
  const std::uint64_t row = std::uint64_t{msg.width} * msg.point_step;
  if (msg.height > 1 && msg.row_step < row) {
    *problem = "cloud claims rows of " + std::to_string(msg.row_step) + " bytes for " + std::to_string(msg.width) +
               " points of " + std::to_string(msg.point_step);
    return false;
  }
  const std::uint64_t needed = std::uint64_t{msg.height - 1} * msg.row_step + row;
  if (needed > msg.data.size()) {
    *problem = "cloud claims " + std::to_string(needed) + " bytes of points and has " + std::to_string(msg.data.size());
    return false;
  }
  return true;
}

}  // namespace cocalib
