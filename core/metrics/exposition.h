// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Appends families of metrics to a text in Prometheus' format (text/plain; version=0.0.4).
class Exposition {
 public:
  /// Begins a family: a counter if its name ends in _total, else a gauge. `help` is one line.
  void family(const std::string& name, const std::string& help);
  /// Adds a sample of the family. `labels`: "" or "{a=\"b\"}".
  void sample(double value, const std::string& labels = "");
  /// Adds a family of one sample without labels.
  void single(const std::string& name, const std::string& help, double value);

  const std::string& text() const { return text_; }

 private:
  std::string name_, text_;
};

/// Returns name="value", with the value's special characters escaped.
std::string metric_label(const std::string& name, const std::string& value);

}  // namespace citylearn
