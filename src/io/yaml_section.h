#pragma once

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace cocalib {

/// What is wrong with a file of ours: one line with file, line, key, value and what is allowed.
class YamlError : public std::runtime_error {
 public:
  explicit YamlError(const std::string& words) : std::runtime_error(inOneLine(words)) {}

 private:
  /// A key may hold a line break.
  static std::string inOneLine(std::string words) {
    std::replace(words.begin(), words.end(), '\n', ' ');
    return words;
  }
};

/// Decimal number, .inf, -.inf or .nan, whatever the locale (yaml-cpp minds it); false for anything else.
bool decodeNumber(const YAML::Node& node, double* number);

/// One mapping of a YAML file, read strictly: every value is checked, and finish() refuses the keys that nobody asked
/// for.
class YamlSection {
 public:
  /// @param name  path of keys down to here, "imu" or "lidar: point_time"; empty at the top
  /// @throws YamlError if it is no mapping or a key stands twice
  YamlSection(const YAML::Node& node, std::string file, std::string name);

  bool has(const std::string& key);
  YamlSection section(const std::string& key);

  std::string text(const std::string& key);
  /// One of `allowed`.
  std::string word(const std::string& key, const std::vector<std::string>& allowed);
  /// Finite and within [low, high]; `unit` is said in the message.
  double number(const std::string& key, double low, double high, const std::string& unit);
  double numberOr(const std::string& key, double low, double high, const std::string& unit, double fallback);
  /// Any number, .inf and .nan too, as results may hold them.
  double real(const std::string& key);
  std::vector<double> reals(const std::string& key, int count);
  int integer(const std::string& key, int low, int high);
  /// Finite numbers; `count` of them, or any number up to 16 if negative.
  std::vector<double> numbers(const std::string& key, int count);
  std::vector<std::string> texts(const std::string& key);
  /// The node as it stands, for what the above cannot read.
  YAML::Node node(const std::string& key);

  /// @throws YamlError for a key that has not been asked for, with the known key that looks most like it
  void finish() const;

  /// Refuses a value for a reason of the caller's.
  [[noreturn]] void fail(const std::string& key, const std::string& why) const;

 private:
  YAML::Node require(const std::string& key);
  double scalar(const YAML::Node& value, const std::string& key) const;

  YAML::Node node_;
  std::string file_, name_;
  std::set<std::string> known_;
};

}  // namespace cocalib
