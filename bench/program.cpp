#include "program.h"

#include <cstdio>
#include <ctime>
#include <exception>
#include <iostream>

namespace cocalib::bench {

int runProgram(const char* name, int argc, char** argv, const boost::program_options::options_description& options,
               const std::function<void()>& run) {
  namespace po = boost::program_options;
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, options), values);
    if (values.count("help") > 0) {
      std::cout << options << '\n';
      return 0;
    }
    po::notify(values);
    run();
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", name, error.what());
    return 1;
  }
}

double processCpu() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

}  // namespace cocalib::bench
