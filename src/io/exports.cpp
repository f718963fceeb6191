#include "cocalib/io/exports.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "export_formats.h"
#include "text_format.h"

namespace cocalib {
namespace {

/// Which parts of the calibration a format holds.
enum class Needs { kCamera, kLidar, kBoth, kAny };

struct Format {
  const char* name;
  Needs needs;
  std::string (*make)(const ExportSource&);
};

constexpr std::array<Format, 9> kFormats = {{
    {"camchain-imucam.yaml", Needs::kCamera, formatKalibrChain},
    {"open_vins.yaml", Needs::kCamera, formatOpenVins},
    {"vins_mono.yaml", Needs::kCamera, formatVinsMono},
    {"lvi_sam_camera.yaml", Needs::kBoth, formatLviSamCamera},
    {"lvi_sam_lidar.yaml", Needs::kLidar, formatLviSamLidar},
    {"lio_sam.yaml", Needs::kLidar, formatLioSam},
    {"fast_lio.yaml", Needs::kLidar, formatFastLio},
    {"sensors.urdf.xacro", Needs::kAny, formatUrdf},
    {"static_transforms.launch", Needs::kAny, formatStaticTransforms},
}};

}  // namespace

ExportComment& ExportComment::work(const Pose& T_to_from, const std::string& from, const std::string& to) {
  const Eigen::Vector3d p(1.0, 2.0, 3.0), q = T_to_from * p;
  char text[200];
  std::snprintf(text, sizeof text, "Worked point: (1, 2, 3) m in the %s frame is (%.6f, %.6f, %.6f) m in the %s frame.",
                from.c_str(), q.x(), q.y(), q.z(), to.c_str());
  return say(text);
}

ExportComment& ExportComment::sayStatus(const CalibrationEstimate& estimate) {
  say("Written by cocalib; calibration.yaml beside this file holds the same with its uncertainty.");
  if (estimate.status == Status::kConverged) return *this;
  return say("CAUTION: the calibration's status is " + std::string(toString(estimate.status)) +
             ", see calibration.yaml for what is not determined.");
}

std::optional<Eigen::Vector4d> fourCoefficients(const CameraModel& camera) {
  const std::vector<double>& k = camera.coefficients();
  if (camera.distortion() == CameraModel::Distortion::kRational) return std::nullopt;
  if (std::any_of(k.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(4, k.size())), k.end(),
                  [](double coefficient) { return coefficient != 0.0; })) {
    return std::nullopt;
  }
  Eigen::Vector4d four = Eigen::Vector4d::Zero();
  for (std::size_t i = 0; i < std::min<std::size_t>(4, k.size()); ++i) four[static_cast<Eigen::Index>(i)] = k[i];
  return four;
}

std::string formatRows(const Eigen::Matrix3d& R) {
  Eigen::Matrix<double, 9, 1> rows;
  rows << R.row(0).transpose(), R.row(1).transpose(), R.row(2).transpose();
  return formatList(rows);
}

Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R) {
  const double roll = std::atan2(R(2, 1), R(2, 2)), s = std::sin(roll), c = std::cos(roll);
  return {roll, std::atan2(-R(2, 0), s * R(2, 1) + c * R(2, 2)),
          std::atan2(s * R(0, 2) - c * R(0, 1), c * R(1, 1) - s * R(1, 2))};
}

std::vector<NamedText> formatExports(const RigConfig& rig, const std::optional<CameraModel>& camera,
                                     const CalibrationEstimate& estimate) {
  const bool has_camera = rig.camera && camera && estimate.camera.valid;
  const bool has_lidar = rig.lidar && estimate.lidar.valid;
  const auto isMet = [&](Needs needs) {
    switch (needs) {
      case Needs::kCamera:
        return has_camera;
      case Needs::kLidar:
        return has_lidar;
      case Needs::kBoth:
        return has_camera && has_lidar;
      case Needs::kAny:
        break;
    }
    return has_camera || has_lidar;
  };
  std::vector<NamedText> files;
  for (const Format& format : kFormats) {
    if (isMet(format.needs)) files.push_back({format.name, format.make({rig, camera, estimate})});
  }
  return files;
}

std::vector<std::string> exportNames() {
  std::vector<std::string> names;
  for (const Format& format : kFormats) names.emplace_back(format.name);
  return names;
}

}  // namespace cocalib
