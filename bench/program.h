#pragma once

#include <boost/program_options.hpp>
#include <functional>

namespace cocalib::bench {

/// The main of a benchmark: reads the command line by `options`, answers --help, and runs.
/// @return exit status: 0, or 1 with one line on stderr for a wrong command line or any exception
int runProgram(const char* name, int argc, char** argv, const boost::program_options::options_description& options,
               const std::function<void()>& run);

/// Processor time of this process so far, all threads together [s].
double processCpu();

}  // namespace cocalib::bench
