/// calibrate_board: lidar against camera from a recording of boards at rest; no IMU, no guess.

#include <boost/program_options.hpp>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>

#include "cocalib/io/result_file.h"
#include "cocalib/io/rig_file.h"
#include "cocalib/ros/board_calibration.h"
#include "cocalib/ros/result_files.h"

namespace {

namespace options = boost::program_options;
constexpr int kInputError = 1, kUsageError = 2;

options::options_description describeOptions() {
  options::options_description all("usage: calibrate_board --rig RIG.yaml --bag FILE.bag [options]");
  all.add_options()("help,h", "this text")("rig", options::value<std::string>()->required(), "what the robot carries")(
      "bag", options::value<std::string>()->required(), "the recording: board and rig at rest for every view")(
      "output", options::value<std::string>()->default_value("output"), "directory for lidar_camera.yaml");
  return all;
}

/// @throws boost::program_options::error on wrong usage
options::variables_map parseArguments(int argc, char** argv) {
  const options::options_description all = describeOptions();
  options::variables_map values;
  using namespace options::command_line_style;
  options::store(
      options::command_line_parser(argc, argv).options(all).positional({}).style(unix_style & ~allow_guessing).run(),
      values);
  if (values.count("help") != 0) {
    std::cout << all;
    std::exit(0);
  }
  options::notify(values);
  return values;
}

void print(const cocalib::BoardCalibration& calibration) {
  std::printf("board found in %d of %d pictures; plates of its size in %d of %d sweeps\n",
              calibration.images_with_board, calibration.images, calibration.clouds_with_plate, calibration.clouds);
  if (!calibration.start) return;
  const cocalib::LidarCameraStart& start = *calibration.start;
  const Eigen::Vector3d& t = start.T_lidar_camera.t;
  const Eigen::Quaterniond& q = start.T_lidar_camera.q;
  const cocalib::Vector6d& s = start.sigma;
  constexpr double kDegrees = 180.0 / 3.14159265358979323846;
  std::printf("%d views agree: points %.1f mm, outline %.1f mm from the board (RMS)\n", start.used_views,
              1e3 * start.plane_rms_m, 1e3 * start.edge_rms_m);
  std::printf("T_lidar_camera  translation [m]  %9.4f %9.4f %9.4f   +- %.1f %.1f %.1f mm\n", t.x(), t.y(), t.z(),
              1e3 * s[0], 1e3 * s[1], 1e3 * s[2]);
  std::printf("                rotation xyzw    %9.5f %9.5f %9.5f %9.5f   +- %.2f %.2f %.2f deg\n", q.x(), q.y(), q.z(),
              q.w(), kDegrees * s[3], kDegrees * s[4], kDegrees * s[5]);
}

void calibrate(const options::variables_map& arguments) {
  const cocalib::RigConfig rig = cocalib::loadRigFile(arguments["rig"].as<std::string>());
  const std::string output = arguments["output"].as<std::string>();
  cocalib::prepareOutputDirectory(output);
  const cocalib::BoardCalibration calibration =
      cocalib::calibrateFromBoards(arguments["bag"].as<std::string>(), rig,
                                   [](int done, int total) { std::fprintf(stderr, "view %d of %d\n", done, total); });
  print(calibration);
  if (!calibration.start) throw std::runtime_error(calibration.reason);
  const std::string file = output + "/lidar_camera.yaml";
  cocalib::writeFileAtomically(file, cocalib::formatBoardCalibration(calibration));
  std::printf("written: %s\n", file.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  options::variables_map arguments;
  try {
    arguments = parseArguments(argc, argv);
  } catch (const options::error& error) {
    std::cerr << "calibrate_board: " << error.what() << "\n" << describeOptions();
    return kUsageError;
  }
  try {
    calibrate(arguments);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "calibrate_board: " << error.what() << "\n";
  }
  return kInputError;
}
