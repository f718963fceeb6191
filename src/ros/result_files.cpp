#include "cocalib/ros/result_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "cocalib/io/exports.h"
#include "cocalib/io/result_file.h"
#include "cocalib/ros/run_report.h"

namespace cocalib {
namespace {

void writePicture(const std::string& path, const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", picture, bytes)) throw std::runtime_error(path + ": the picture could not be encoded");
  writeFileAtomically(path, std::string(bytes.begin(), bytes.end()));
}

void writeOverlays(const std::string& directory, const RigConfig& rig, const RunResult& result) {
  const OverlayCalibration before = {nominalCalibration(rig.guess_T_imu_camera, rig.guess_T_imu_lidar), std::nullopt,
                                     rig.guess_T_imu_camera || rig.guess_T_imu_lidar
                                         ? "before: the initial guess"
                                         : "before: nothing known, axes parallel"};
  const OverlayCalibration after = {result.estimate.calibration, result.T_W_B,
                                    std::string("after: ") + toString(result.estimate.status)};
  writePicture(directory + "/overlay_before.png", drawOverlay(*result.scene, before, *result.camera, rig.target));
  writePicture(directory + "/overlay_after.png", drawOverlay(*result.scene, after, *result.camera, rig.target));
}

/// Files for other programs. Those of an earlier run that this one cannot make would contradict calibration.yaml.
void writeExports(const std::string& directory, const RigConfig& rig, const RunResult& result) {
  const std::vector<NamedText> files = formatExports(rig, result.camera, result.estimate);
  for (const NamedText& file : files) writeFileAtomically(directory + "/" + file.name, file.text);
  for (const std::string& name : exportNames()) {
    const auto isIt = [&name](const NamedText& file) { return file.name == name; };
    std::error_code ignored;
    if (std::none_of(files.begin(), files.end(), isIt)) std::filesystem::remove(directory + "/" + name, ignored);
  }
}

}  // namespace

void prepareOutputDirectory(const std::string& directory) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  std::error_code unreachable;
  if (!std::filesystem::is_directory(directory, unreachable)) {
    throw std::runtime_error(directory + ": cannot be made (" + (error ? error.message() : "it is a file") +
                             "); choose another output directory");
  }
  if (faccessat(AT_FDCWD, directory.c_str(), W_OK, AT_EACCESS) != 0) {
    throw std::runtime_error(directory + ": cannot be written to; choose another output directory");
  }
}

void writeResultFiles(const std::string& directory, const RigConfig& rig, const RunResult& result) {
  prepareOutputDirectory(directory);  // hours may have passed since the start: it may be gone
  const ResultContents contents = {rig.camera.has_value(), rig.lidar.has_value()};
  writeFileAtomically(directory + "/calibration.yaml", formatResult(result.estimate, contents));
  writeExports(directory, rig, result);
  writeFileAtomically(directory + "/report.html", makeReport(rig, result));
  writeFileAtomically(directory + "/convergence.csv", result.log.csv());
  writePicture(directory + "/convergence.png", result.log.draw());
  if (result.scene && result.camera) writeOverlays(directory, rig, result);
}

}  // namespace cocalib
