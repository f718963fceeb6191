// Rig files.

#include <cstddef>
#include <cstdint>

#include "cocalib/io/rig_file.h"
#include "expect.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  const std::string path = "rig.yaml";
  const std::string text(reinterpret_cast<const char*>(data), count);
  readOrRefuse(path, [&] { cocalib::parseRig(text, path); });
  return 0;
}
