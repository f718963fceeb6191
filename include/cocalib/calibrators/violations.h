#pragma once

#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace cocalib {

/// Gathers every broken bound of one parameter set, so that a user fixes it in one pass.
class Violations {
 public:
  explicit Violations(std::string owner) : owner_(std::move(owner)) {}

  void requireWithin(const char* name, double value, double low, double high) {
    if (value >= low && value <= high) return;  // NaN fails too
    std::ostringstream rule;
    rule << "; " << name << " = " << value << " must be within " << low << " .. " << high;
    text_ += rule.str();
  }
  /// @throws std::invalid_argument naming the owner and every broken bound, if there is one
  void throwIfAny() const {
    if (!text_.empty()) throw std::invalid_argument(owner_ + ": invalid parameters" + text_);
  }

 private:
  std::string owner_;
  std::string text_;
};

}  // namespace cocalib
