#include "yaml_section.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <locale>
#include <numeric>
#include <sstream>
#include <utility>

namespace cocalib {
namespace {

std::string format(double value) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  out << value;
  return out.str();
}

std::string join(const std::vector<std::string>& words) {
  std::string joined;
  for (const std::string& word : words) joined += (joined.empty() ? "" : " | ") + word;
  return joined;
}

/// Number of letters to insert, delete or exchange (Levenshtein).
std::size_t editDistance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0U);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t exchanged = diagonal + (a[i - 1] == b[j - 1] ? 0U : 1U);
      diagonal = row[j];
      row[j] = std::min({exchanged, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row[b.size()];
}

std::string nearestKey(const std::string& key, const std::set<std::string>& known) {
  std::string nearest;
  std::size_t smallest = std::max<std::size_t>(2, key.size() / 3) + 1;
  for (const std::string& candidate : known) {
    const std::size_t distance = editDistance(key, candidate);
    if (distance < smallest) {
      smallest = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

/// What the user wrote, cut short and on one line.
std::string quote(const YAML::Node& value) {
  if (value.IsNull()) return "(nothing)";
  if (!value.IsScalar()) return value.IsSequence() ? "[...]" : "{...}";
  std::string text = value.Scalar().substr(0, 60);
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

}  // namespace

bool decodeNumber(const YAML::Node& node, double* number) {
  if (!node.IsScalar()) return false;
  const std::string text = node.Scalar();
  const bool negative = !text.empty() && text.front() == '-';
  const std::string word = text.substr(negative ? 1 : 0);
  if (word == ".nan" || word == ".inf") {
    using Limits = std::numeric_limits<double>;
    *number = word == ".nan" ? Limits::quiet_NaN() : (negative ? -1.0 : 1.0) * Limits::infinity();
    return true;
  }
  std::istringstream in(text);
  in.imbue(std::locale::classic());
  return in >> *number && in.peek() == std::istringstream::traits_type::eof();
}

YamlSection::YamlSection(const YAML::Node& node, std::string file, std::string name)
    : node_(node), file_(std::move(file)), name_(std::move(name)) {
  const std::string what = name_.empty() ? "the file" : "'" + name_ + "'";
  if (!node_.IsMap()) throw YamlError(file_ + ": " + what + " must be a mapping (key: value)");
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!entry.first.IsScalar()) throw YamlError(file_ + ": " + what + " has a key that is no word");
    if (!seen.insert(entry.first.Scalar()).second) fail(entry.first.Scalar(), "stands twice");
  }
}

void YamlSection::fail(const std::string& key, const std::string& why) const {
  const YAML::Node value = node_[key];
  const std::string line =
      value.IsDefined() && value.Mark().line >= 0 ? " line " + std::to_string(value.Mark().line + 1) : std::string();
  const std::string path = name_.empty() ? key : name_ + ": " + key;
  const std::string shown = value.IsDefined() ? " = " + quote(value) : std::string();
  throw YamlError(file_ + line + ": '" + path + "'" + shown + ": " + why);
}

YAML::Node YamlSection::require(const std::string& key) {
  known_.insert(key);
  const YAML::Node value = static_cast<const YAML::Node&>(node_)[key];
  if (!value.IsDefined()) {
    std::set<std::string> others;
    for (const auto& entry : node_) {
      if (known_.count(entry.first.Scalar()) == 0) others.insert(entry.first.Scalar());
    }
    const std::string misspelt = nearestKey(key, others);
    fail(key, misspelt.empty() ? "is missing" : "is missing; is '" + misspelt + "' meant to be it?");
  }
  if (value.IsNull()) fail(key, "is empty");
  return value;
}

bool YamlSection::has(const std::string& key) {
  known_.insert(key);
  return static_cast<const YAML::Node&>(node_)[key].IsDefined();
}

YAML::Node YamlSection::node(const std::string& key) { return require(key); }

YamlSection YamlSection::section(const std::string& key) {
  const YAML::Node value = require(key);
  return YamlSection(value, file_, name_.empty() ? key : name_ + ": " + key);
}

std::string YamlSection::text(const std::string& key) {
  const YAML::Node value = require(key);
  if (!value.IsScalar()) fail(key, "must be a word");
  if (value.Scalar().empty()) fail(key, "is empty");
  return value.Scalar();
}

std::string YamlSection::word(const std::string& key, const std::vector<std::string>& allowed) {
  const std::string value = text(key);
  if (std::find(allowed.begin(), allowed.end(), value) == allowed.end()) fail(key, "must be " + join(allowed));
  return value;
}

double YamlSection::scalar(const YAML::Node& value, const std::string& key) const {
  double number = 0.0;
  if (!decodeNumber(value, &number)) fail(key, "must be a number");
  return number;
}

double YamlSection::number(const std::string& key, double low, double high, const std::string& unit) {
  const double value = scalar(require(key), key);
  if (!(value >= low && value <= high)) {
    const std::string with_unit = unit.empty() ? "" : " " + unit;
    fail(key, "must be in [" + format(low) + ", " + format(high) + "]" + with_unit);
  }
  return value;
}

double YamlSection::numberOr(const std::string& key, double low, double high, const std::string& unit,
                             double fallback) {
  return has(key) ? number(key, low, high, unit) : fallback;
}

int YamlSection::integer(const std::string& key, int low, int high) {
  const double value = scalar(require(key), key);
  if (!(value >= low && value <= high) || value != std::floor(value)) {
    fail(key, "must be a whole number in [" + std::to_string(low) + ", " + std::to_string(high) + "]");
  }
  return static_cast<int>(value);
}

double YamlSection::real(const std::string& key) { return scalar(require(key), key); }

std::vector<double> YamlSection::reals(const std::string& key, int count) {
  constexpr std::size_t kMost = 16;
  const YAML::Node value = require(key);
  const std::string wanted = count < 0 ? "numbers" : std::to_string(count) + " numbers";
  if (!value.IsSequence() || value.size() > kMost || (count >= 0 && value.size() != static_cast<std::size_t>(count))) {
    fail(key, "must be a list of " + wanted);
  }
  std::vector<double> result;
  for (const auto& element : value) result.push_back(scalar(element, key));
  return result;
}

std::vector<double> YamlSection::numbers(const std::string& key, int count) {
  std::vector<double> result = reals(key, count);
  if (!std::all_of(result.begin(), result.end(), [](double v) { return std::isfinite(v); })) {
    fail(key, "must be a list of finite numbers");
  }
  return result;
}

std::vector<std::string> YamlSection::texts(const std::string& key) {
  const YAML::Node value = require(key);
  if (!value.IsSequence()) fail(key, "must be a list");
  std::vector<std::string> result;
  for (const auto& element : value) {
    if (!element.IsScalar()) fail(key, "must be a list of words");
    result.push_back(element.Scalar());
  }
  return result;
}

void YamlSection::finish() const {
  for (const auto& entry : node_) {
    const std::string key = entry.first.Scalar();
    if (known_.count(key) > 0) continue;
    const std::string nearest = nearestKey(key, known_);
    std::string why = "unknown key";
    if (!nearest.empty()) {
      why += "; did you mean '" + nearest + "'?";
    } else {
      why += "; known: " + join({known_.begin(), known_.end()});
    }
    fail(key, why);
  }
}

}  // namespace cocalib
