/// calibrate_bag: calibrates from a recording, without a ROS master and faster than real time.

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <chrono>
#include <cstdio>
#include <exception>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <string>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/bag_calibration.h"
#include "cocalib/ros/bag_input.h"
#include "cocalib/ros/result_files.h"

namespace {

namespace options = boost::program_options;
constexpr int kInputError = 1, kUsageError = 2;

struct Arguments {
  std::string rig, bag, output, initial_guess;
  double start_s = 0.0;
  std::optional<double> duration_s;
  bool timing = false;
};

/// One line that is rewritten on a terminal; in a file or a pipe, one line every tenth of the way.
class ProgressBar {
 public:
  void show(const std::string& stage, double part) {
    const int percent = static_cast<int>(100.0 * part);
    if (terminal_ ? percent == percent_ && stage == stage_ : percent < percent_ + 10 && stage == stage_) return;
    percent_ = percent;
    stage_ = stage;
    constexpr int kWidth = 30;
    const int filled = std::clamp(static_cast<int>(part * kWidth), 0, kWidth);
    const std::string bar = std::string(filled, '#') + std::string(kWidth - filled, '.');
    std::fprintf(stderr, "%s[%s] %3d %%  %-24s %-14s%s", terminal_ ? "\r" : "", bar.c_str(), percent, stage.c_str(),
                 timeLeft(part).c_str(), terminal_ ? "" : "\n");
    open_line_ = terminal_;
  }
  /// Ends the line, so that other text can follow.
  void interrupt() {
    if (open_line_) std::fputc('\n', stderr);
    open_line_ = false;
  }

 private:
  std::string timeLeft(double part) const {
    const double gone_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
    if (part >= 1.0) return std::to_string(static_cast<int>(gone_s)) + " s in all";
    if (part < 0.02) return "";
    return std::to_string(static_cast<int>(gone_s * (1.0 - part) / part) + 1) + " s left";
  }

  const bool terminal_ = isatty(STDERR_FILENO) != 0;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  int percent_ = -100;
  std::string stage_;
  bool open_line_ = false;
};

options::options_description describeOptions() {
  options::options_description all("usage: calibrate_bag --rig RIG.yaml --bag FILE.bag [options]");
  all.add_options()("help,h", "this text")("rig", options::value<std::string>()->required(), "what the robot carries")(
      "bag", options::value<std::string>()->required(), "the recording")(
      "initial-guess", options::value<std::string>()->default_value(""),
      "calibration.yaml of an earlier run to go on from, with its covariance")(
      "output", options::value<std::string>()->default_value("output"), "directory for the result")(
      "start", options::value<double>()->default_value(0.0), "seconds of the bag to skip")(
      "duration", options::value<double>(), "seconds of the bag to use")("timing",
                                                                         "say at the end how long each stage took");
  return all;
}

/// @throws boost::program_options::error on wrong usage
Arguments parseArguments(int argc, char** argv) {
  const options::options_description all = describeOptions();
  options::variables_map values;
  // Abbreviated options would change their meaning with every option that is added.
  using namespace options::command_line_style;
  options::store(
      options::command_line_parser(argc, argv).options(all).positional({}).style(unix_style & ~allow_guessing).run(),
      values);
  if (values.count("help") != 0) {
    std::cout << all;
    std::exit(0);
  }
  options::notify(values);
  Arguments arguments;
  arguments.rig = values["rig"].as<std::string>();
  arguments.bag = values["bag"].as<std::string>();
  arguments.initial_guess = values["initial-guess"].as<std::string>();
  arguments.output = values["output"].as<std::string>();
  arguments.start_s = values["start"].as<double>();
  arguments.timing = values.count("timing") != 0;
  if (values.count("duration") != 0) arguments.duration_s = values["duration"].as<double>();
  if (!(arguments.start_s >= 0.0)) throw options::error("--start must be 0 or more seconds");
  if (arguments.duration_s && !(*arguments.duration_s > 0.0)) throw options::error("--duration must be more than 0 s");
  if (arguments.output.empty()) throw options::error("--output must name a directory");
  return arguments;
}

/// What suits a program that does nothing but this: it has stages enough for all cores, so that threads for parts of
/// one picture only get in their way; and memory of pictures and sweeps goes from one to the next, not back to the
/// system and, cleared page by page, here again.
void useWholeMachine() {
  cv::setNumThreads(1);
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // bytes; no more is allowed
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
}

void calibrate(const Arguments& arguments) {
  cocalib::RigConfig rig = cocalib::loadRigFile(arguments.rig);
  if (!arguments.initial_guess.empty()) cocalib::goOnFrom(arguments.initial_guess, &rig);
  cocalib::BagInput input(arguments.bag, rig, arguments.start_s, arguments.duration_s);
  cocalib::prepareOutputDirectory(arguments.output);
  ProgressBar bar;
  cocalib::BagCalibration::Listener listener;
  listener.progress = [&bar](const std::string& stage, double part) { bar.show(stage, part); };
  listener.notice = [&bar](const std::string& line) {
    bar.interrupt();
    std::fprintf(stderr, "%s\n", line.c_str());
  };
  cocalib::BagCalibration calibration(rig, &input, listener);
  cocalib::RunResult result;
  try {
    result = calibration.run();
  } catch (const std::exception&) {
    bar.interrupt();
    throw;
  }
  bar.interrupt();
  cocalib::writeResultFiles(arguments.output, rig, result);
  std::cout << cocalib::describeResult(rig, result.estimate) << "written: " << arguments.output
            << "/calibration.yaml\n";
  if (!arguments.timing) return;
  for (const auto& [stage, seconds] : calibration.stageSeconds()) {
    std::printf("timing: %-10s %7.2f s\n", stage.c_str(), seconds);
  }
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  try {
    arguments = parseArguments(argc, argv);
  } catch (const options::error& error) {
    std::cerr << "calibrate_bag: " << error.what() << "\n" << describeOptions();
    return kUsageError;
  }
  try {
    useWholeMachine();
    calibrate(arguments);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "calibrate_bag: " << error.what() << "\n";
  }
  return kInputError;
}
