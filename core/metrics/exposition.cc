// SPDX-License-Identifier: Apache-2.0
#include "core/metrics/exposition.h"

#include <spdlog/fmt/fmt.h>

namespace citylearn {

void Exposition::family(const std::string& name, const std::string& help) {
  name_ = name;
  text_ += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n", name, help, name.ends_with("_total") ? "counter" : "gauge");
}

void Exposition::sample(double value, const std::string& labels) {
  text_ += fmt::format("{}{} {}\n", name_, labels, value);
}

void Exposition::single(const std::string& name, const std::string& help, double value) {
  family(name, help);
  sample(value);
}

std::string metric_label(const std::string& name, const std::string& value) {
  std::string text = name + "=\"";
  for (const char c : value) text += c == '\n' ? "\\n" : c == '"' || c == '\\' ? std::string{'\\', c} : std::string{c};
  return text + '"';
}

}  // namespace citylearn
