// SPDX-License-Identifier: Apache-2.0
#include "core/plugin/registry.h"

#include <cmath>
#include <sstream>

namespace citylearn {
namespace {

std::string text_of(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

}  // namespace

Registrations& registrations() {
  static Registrations all;
  return all;
}

Parameters::Parameters(const std::string& owner, const std::vector<ParameterSpec>& specs,
                       const std::map<std::string, double>& values) {
  for (const ParameterSpec& spec : specs) values_[spec.name] = spec.default_value;
  for (const auto& [name, value] : values) {
    const auto spec =
        std::find_if(specs.begin(), specs.end(), [&wanted = name](const ParameterSpec& s) { return s.name == wanted; });
    if (spec == specs.end())
      throw Error("unknown parameter '" + name + "'", owner,
                  specs.empty() ? "it has none" : "known: " + joined(specs, &ParameterSpec::name));
    if (!(value >= spec->minimum && value <= spec->maximum))  // so written, NaN is refused
      throw Error("is " + text_of(value) + ", must be " + text_of(spec->minimum) + ".." + text_of(spec->maximum),
                  owner + "." + name);
    if (spec->integer && value != std::floor(value))
      throw Error("is " + text_of(value) + ", must be a whole number", owner + "." + name);
    values_[name] = value;
  }
}

double Parameters::operator[](const std::string& name) const {
  const auto found = values_.find(name);
  if (found == values_.end()) throw Error("parameter '" + name + "' was never declared");
  return found->second;
}

}  // namespace citylearn
