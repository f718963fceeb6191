#pragma once

#include <Eigen/Core>
#include <string>

namespace cocalib {

/// Shortest decimal number of 15 to 17 digits that reads back as the same double, whatever the locale; always with a
/// point or an exponent, so that every reader of YAML takes it for a real number.
std::string formatNumber(double value);

/// "[a, b, c]"
template <typename Derived>
std::string formatList(const Eigen::MatrixBase<Derived>& values) {
  std::string text = "[";
  for (Eigen::Index i = 0; i < values.size(); ++i) text += (i > 0 ? ", " : "") + formatNumber(values[i]);
  return text + "]";
}

}  // namespace cocalib
