// Scenario files.

#include <cstddef>
#include <cstdint>

#include "cocalib/sim/scenario.h"
#include "expect.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  const std::string path = "scenario.yaml";
  const std::string text(reinterpret_cast<const char*>(data), count);
  readOrRefuse(path, [&] { cocalib::sim::parseScenario(text, path); });
  return 0;
}
