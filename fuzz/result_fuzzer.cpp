// Results of earlier runs, from which a run may go on.

#include <cstddef>
#include <cstdint>

#include "cocalib/io/result_file.h"
#include "expect.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  const std::string path = "result.yaml";
  const std::string text(reinterpret_cast<const char*>(data), count);
  readOrRefuse(path, [&] { cocalib::parseResult(text, path); });
  return 0;
}
