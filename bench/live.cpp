#include "live.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "statistics.h"

namespace cocalib::bench {
namespace {

constexpr double kNear_rad = M_PI / 180.0, kNear_m = 0.05;
constexpr double kManySigmas = 3.0;

/// One sensor in one line of the file.
struct Side {
  bool valid;
  double turn_rad, shift_m;  ///< error, norm over the axes
  double ratio;              ///< largest error over its sigma, of the seven parameters

  bool isNear() const { return valid && turn_rad <= kNear_rad && shift_m <= kNear_m; }
};

/// `cells`: valid, translation, quaternion, offset, then the sigmas.
Side sideOf(const double* cells, const Pose& truth, double true_offset_s) {
  const Eigen::Quaterniond q(cells[7], cells[4], cells[5], cells[6]);
  Eigen::Matrix<double, 7, 1> error;
  const Pose pose{q.normalized(), {cells[1], cells[2], cells[3]}};
  error << pose.minus(truth), cells[8] - true_offset_s;
  Side side{cells[0] > 0.0, error.segment<3>(3).norm(), error.head<3>().norm(), 0.0};
  for (int i = 0; side.valid && i < 7; ++i) side.ratio = std::max(side.ratio, std::abs(error[i]) / cells[9 + i]);
  return side;
}

/// When something became true for good [s]; infinity while it is not.
struct Since {
  double time_s = std::numeric_limits<double>::infinity();

  void note(bool holds, double now_s) {
    time_s = holds ? std::min(time_s, now_s) : std::numeric_limits<double>::infinity();
  }
};

struct Counts {
  int estimates = 0, converged = 0, beyond = 0, beyond_converged = 0;
  double worst = 0.0;
  Since camera, lidar, both_converged;
};

void addRow(const std::string& row, const Calibration& truth, Counts* counts) {
  constexpr std::size_t kSide = 16;
  std::stringstream cells(row);
  std::string cell, status;
  std::getline(cells, cell, ',');
  const double time_s = std::stod(cell);
  std::getline(cells, status, ',');
  std::array<double, 2 * kSide> numbers;
  for (double& number : numbers) {
    if (!std::getline(cells, cell, ',')) throw std::runtime_error("a line has too few numbers");
    number = std::stod(cell);
  }
  const Side camera = sideOf(numbers.data(), truth.T_imu_camera, truth.camera_time_offset_s);
  const Side lidar = sideOf(numbers.data() + kSide, truth.T_imu_lidar, truth.lidar_time_offset_s);
  if (!camera.valid && !lidar.valid) return;
  const bool converged = status == toString(Status::kConverged);
  const double ratio = std::max(camera.ratio, lidar.ratio);
  ++counts->estimates;
  counts->converged += converged;
  counts->beyond += ratio > kManySigmas;
  counts->beyond_converged += converged && ratio > kManySigmas;
  counts->worst = std::max(counts->worst, ratio);
  counts->camera.note(camera.isNear(), time_s);
  counts->lidar.note(lidar.isNear(), time_s);
  counts->both_converged.note(converged, time_s);
}

}  // namespace

std::string liveLine(const std::string& result_dir, const Calibration& truth) {
  const std::string path = result_dir + "/convergence.csv";
  std::ifstream file(path);
  std::string row;
  if (!std::getline(file, row)) throw std::runtime_error(path + ": cannot be read");
  Counts counts;
  try {
    while (std::getline(file, row)) addRow(row, truth, &counts);
  } catch (const std::exception& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
  char text[320];
  std::snprintf(text, sizeof text,
                "%d estimates, %d of them converged; for good within 1 deg and 5 cm from %.1f s (camera), %.1f s "
                "(lidar), converged from %.1f s; above 3 sigma: %d, %d of them converged; worst %.1f sigma",
                counts.estimates, counts.converged, counts.camera.time_s, counts.lidar.time_s,
                counts.both_converged.time_s, counts.beyond, counts.beyond_converged, counts.worst);
  return text;
}

}  // namespace cocalib::bench
