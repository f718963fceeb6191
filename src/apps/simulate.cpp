/// simulate: makes a bag with exactly known truth from a scenario file.
///
///   simulate --scenario SCENARIO.yaml --bag OUT.bag [--seed N] [--duration S]
///
/// Writes OUT.bag, OUT.truth.yaml and OUT.rig.yaml. Exit code 0: done, 1: the input cannot be used, 2: wrong usage.
#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <future>
#include <iostream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "cocalib/io/result_file.h"
#include "cocalib/ros/bag_writer.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/renderer.h"
#include "cocalib/sim/truth_file.h"

namespace cocalib {
namespace {

using sim::CloudDialect;
using sim::Scenario;

// A driver hands over a picture or a sweep this long after it is complete.
constexpr double kTransfer_s = 0.003;

CloudLayout layoutOf(CloudDialect dialect) {
  switch (dialect) {
    case CloudDialect::kOuster:
      return CloudLayout::kOuster;
    case CloudDialect::kHesai:
      return CloudLayout::kHesai;
    case CloudDialect::kRobosense:
      return CloudLayout::kRobosense;
    case CloudDialect::kLivox:
      return CloudLayout::kLivox;
    case CloudDialect::kLivoxOffset:
      return CloudLayout::kLivoxOffset;
    case CloudDialect::kNoTime:
      return CloudLayout::kNoTime;
    default:
      return CloudLayout::kVelodyne;
  }
}

/// Percent and time left, on one line of a terminal or now and then in a log.
class Progress {
 public:
  explicit Progress(std::string stage) : stage_(std::move(stage)) {}

  void show(std::size_t done, std::size_t total) {
    const int percent = static_cast<int>(100 * done / total);
    const int step = terminal_ ? 1 : 10;
    if (percent / step == shown_ / step && done != total) return;
    shown_ = percent;
    const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    const double left = done > 0 ? elapsed * static_cast<double>(total - done) / static_cast<double>(done) : 0.0;
    std::printf("%s%s %3d %%, %.0f s left   %s", terminal_ ? "\r" : "", stage_.c_str(), percent, left,
                terminal_ && done != total ? "" : "\n");
    std::fflush(stdout);
  }

 private:
  std::string stage_;
  bool terminal_ = isatty(STDOUT_FILENO) != 0;
  int shown_ = -1000;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A picture or a sweep to be made, and what became of it.
struct Job {
  double received_s;
  bool is_image;
  int k;
};
struct Product {
  cv::Mat gray;
  std::vector<std::uint8_t> encoded;
  sensor_msgs::PointCloud2 cloud;
};

class Recording {
 public:
  explicit Recording(const Scenario& scenario)
      : scenario_(scenario), scene_(scenario), trajectory_(scenario), renderer_(scenario, scene_) {}

  void write(const std::string& bag_path) {
    BagWriter bag(bag_path);
    const std::vector<ImuSample> imu = sim::simulateImu(scenario_, trajectory_);
    const std::vector<Job> jobs = makeJobs();
    const std::size_t ahead = std::max(2U, std::thread::hardware_concurrency()) + 1;
    std::deque<std::future<Product>> running;
    std::size_t started = 0, next_imu = 0;
    Progress progress("drawing pictures and sweeps:");
    for (std::size_t i = 0; i < jobs.size(); ++i) {
      for (; started < jobs.size() && running.size() < ahead; ++started) {
        running.push_back(std::async(std::launch::async, [this, job = jobs[started]] { return make(job); }));
      }
      const Product product = running.front().get();
      running.pop_front();
      const TimeNs received = trajectory_.stampOf(jobs[i].received_s);
      for (; next_imu < imu.size() && imu[next_imu].stamp <= received; ++next_imu) writeImu(bag, imu[next_imu]);
      write(bag, jobs[i], received, product);
      progress.show(i + 1, jobs.size());
    }
    for (; next_imu < imu.size(); ++next_imu) writeImu(bag, imu[next_imu]);
    const std::string stem = bag_path.substr(0, bag_path.rfind(".bag"));
    writeFileAtomically(stem + ".truth.yaml", sim::truthText(scenario_, scene_, trajectory_));
    writeFileAtomically(stem + ".rig.yaml", sim::rigText(scenario_));
    bag.finish();
  }

 private:
  std::vector<Job> makeJobs() const {
    std::vector<Job> jobs;
    const Scenario::Camera& camera = scenario_.camera;
    const double readout_s = 0.5 * (camera.exposure_s + camera.line_delay_s * camera.height);
    const sim::PictureFaults faults(scenario_);
    for (int k = 0; k < sim::imageCount(scenario_); ++k) {
      if (faults.isDropped(k)) continue;
      jobs.push_back({sim::imageTime(scenario_, k) + readout_s + kTransfer_s, true, k});
    }
    for (int k = 0; k < sim::scanCount(scenario_); ++k) {
      jobs.push_back({(k + 1) / scenario_.lidar.rate_hz + kTransfer_s, false, k});
    }
    std::stable_sort(jobs.begin(), jobs.end(), [](const Job& a, const Job& b) { return a.received_s < b.received_s; });
    return jobs;
  }

  Product make(const Job& job) const {
    Product product;
    if (!job.is_image) {
      const sim::SimulatedScan simulated = sim::simulateScan(scenario_, scene_, trajectory_, job.k);
      product.cloud = toPointCloud2(simulated.scan, layoutOf(scenario_.lidar.dialect), scenario_.lidar.frame);
      return product;
    }
    product.gray = renderer_.render(trajectory_, job.k);
    const std::string& transport = scenario_.camera.transport;
    if (transport != "raw") cv::imencode(transport == "png" ? ".png" : ".jpg", product.gray, product.encoded);
    return product;
  }

  void writeImu(BagWriter& bag, const ImuSample& sample) const {
    bag.writeImu(sample.stamp, sample, scenario_.imu_topic, scenario_.imu_frame);
  }

  void write(BagWriter& bag, const Job& job, TimeNs received, const Product& product) const {
    const Scenario::Camera& camera = scenario_.camera;
    if (!job.is_image) {
      bag.writeCloud(received, product.cloud, scenario_.lidar.topic);
      return;
    }
    const TimeNs stamp = sim::imageStamp(scenario_, job.k);
    bag.writeCameraInfo(received, stamp, camera.cameraModel(), camera.info_topic, camera.frame);
    if (camera.transport == "raw") {
      bag.writeImage(received, {stamp, product.gray}, camera.topic, camera.frame);
    } else {
      bag.writeCompressedImage(received, stamp, product.encoded, camera.transport, camera.topic + "/compressed",
                               camera.frame);
    }
  }

  Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  sim::Renderer renderer_;
};

struct Arguments {
  std::string scenario, bag;
  std::optional<std::uint64_t> seed;
  std::optional<double> duration_s;
};

constexpr const char* kUsage = "usage: simulate --scenario SCENARIO.yaml --bag OUT.bag [--seed N] [--duration S]";

/// @throws boost::program_options::error for wrong usage; nothing if only help was asked for
std::optional<Arguments> parse(int argc, char** argv) {
  namespace options = boost::program_options;
  Arguments arguments;
  options::options_description description("options");
  description.add_options()("help,h", "show this")("scenario", options::value(&arguments.scenario)->required(),
                                                   "scenario file, see cfg/scenarios/")(
      "bag", options::value(&arguments.bag)->required(), "bag to write; OUT.truth.yaml and OUT.rig.yaml go beside it")(
      "seed", options::value<std::int64_t>(), "other noise and another motion (default: the scenario's)")(
      "duration", options::value<double>(), "seconds (default: the scenario's)");
  options::variables_map values;
  options::store(options::parse_command_line(argc, argv, description), values);
  if (values.count("help") != 0) {
    std::cout << kUsage << "\n" << description;
    return std::nullopt;
  }
  options::notify(values);
  const std::string& bag = arguments.bag;
  if (bag.size() < 5 || bag.compare(bag.size() - 4, 4, ".bag") != 0) {
    throw options::error("--bag " + bag + ": must end in .bag");
  }
  if (values.count("seed") != 0) {
    const std::int64_t seed = values["seed"].as<std::int64_t>();
    if (seed < 0) throw options::error("--seed " + std::to_string(seed) + ": must be 0 or more");
    arguments.seed = static_cast<std::uint64_t>(seed);
  }
  if (values.count("duration") != 0) arguments.duration_s = values["duration"].as<double>();
  return arguments;
}

void run(const Arguments& arguments) {
  Scenario scenario = sim::loadScenario(arguments.scenario);
  if (arguments.seed) scenario.seed = *arguments.seed;
  if (arguments.duration_s) scenario.duration_s = *arguments.duration_s;
  scenario.validate();
  cv::setNumThreads(1);  // whole pictures are made in parallel instead
  std::printf("simulating %s, seed %llu, %.0f s: %d pictures, %d sweeps\n", scenario.name.c_str(),
              static_cast<unsigned long long>(scenario.seed), scenario.duration_s, sim::imageCount(scenario),
              sim::scanCount(scenario));
  Recording(scenario).write(arguments.bag);
  std::printf("written: %s\n", arguments.bag.c_str());
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  std::optional<cocalib::Arguments> arguments;
  try {
    arguments = cocalib::parse(argc, argv);
  } catch (const boost::program_options::error& error) {
    std::cerr << "simulate: " << error.what() << "; " << cocalib::kUsage << "\n";
    return 2;
  }
  if (!arguments) return 0;
  try {
    cocalib::run(*arguments);
  } catch (const std::exception& error) {
    std::cerr << "simulate: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
