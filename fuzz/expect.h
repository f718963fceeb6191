#pragma once

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

/// As assert(), but always on: a promise of a reader that a fuzzer found broken.
#define EXPECT_ALWAYS(condition)                                                   \
  do {                                                                             \
    if (!(condition)) {                                                            \
      std::fprintf(stderr, "%s:%d: broken: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                \
    }                                                                              \
  } while (false)

/// Words for the user are one line, and there are some.
inline void expectOneLine(const std::string& words) {
  EXPECT_ALWAYS(!words.empty());
  EXPECT_ALWAYS(words.find('\n') == std::string::npos);
}

/// Reads a text that may be refused by an exception derived from std::exception, in one line that names the file.
template <typename Read>
void readOrRefuse(const std::string& path, const Read& read) {
  try {
    read();
  } catch (const std::exception& refusal) {
    expectOneLine(refusal.what());
    EXPECT_ALWAYS(std::string(refusal.what()).find(path) != std::string::npos);
  }
}
