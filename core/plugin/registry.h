// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {

/// One parameter of a plug-in: a number with default and range. Booleans are 0 or 1; whole numbers say `integer`.
struct ParameterSpec {
  std::string name;  ///< as on the command line and in TOML: "learning-rate"
  std::string help;  ///< one line, with its unit
  double default_value = 0;
  double minimum = 0;
  double maximum = 0;
  bool integer = false;
  bool recommended = false;  ///< other plug-ins may recommend a value, which then replaces the default
};

/// Values of a plug-in's parameters, checked against its specs.
class Parameters {
 public:
  Parameters() = default;
  /// Defaults from `specs`, then `values` over them. Throws Error naming `owner` and the parameter when one is unknown,
  /// out of its range, or not whole where it should be.
  Parameters(const std::string& owner, const std::vector<ParameterSpec>& specs,
             const std::map<std::string, double>& values);
  /// Throws Error when the plug-in never declared `name`.
  double operator[](const std::string& name) const;
  int integer(const std::string& name) const { return static_cast<int>((*this)[name]); }
  bool flag(const std::string& name) const { return (*this)[name] != 0; }
  const std::map<std::string, double>& values() const { return values_; }

 private:
  std::map<std::string, double> values_;
};

/// All registrations so far, of all kinds.
struct Registrations {
  int count = 0;
  std::vector<std::string> taken;  ///< names that their registry had already, left out
};
Registrations& registrations();

/// All plug-ins of one kind. A plug-in is one file that ends in a static Registration; unknown names list the known
/// ones.
template <class Product, class... Arguments>
class Registry {
 public:
  using Factory = std::function<std::unique_ptr<Product>(const Parameters&, Arguments...)>;
  struct Entry {
    std::string name;
    std::string help;
    std::vector<ParameterSpec> parameters;
    Factory create;
    std::map<std::string, double> recommended =
        {};  ///< values for plug-ins used with this one (a network's for its learner)
    std::vector<std::pair<std::string, std::string>> about = {};  ///< more for --list: {"licence", "MIT"}
  };
  struct Registration {
    explicit Registration(Entry entry) { instance().add(std::move(entry)); }
  };

  static Registry& instance() {
    static Registry registry;
    return registry;
  }
  /// Returns all entries, sorted by name.
  std::vector<const Entry*> entries() const {
    std::vector<const Entry*> sorted;
    for (const Entry& entry : entries_) sorted.push_back(&entry);
    std::sort(sorted.begin(), sorted.end(), [](auto* a, auto* b) { return a->name < b->name; });
    return sorted;
  }
  /// Throws Error that lists the known names when there is none. `kind` is for that message: "network".
  const Entry& find(const std::string& kind, const std::string& name) const {
    for (const Entry& entry : entries_)
      if (entry.name == name) return entry;
    throw Error("unknown " + kind + " '" + name + "'", "", "known: " + joined(entries(), &Entry::name));
  }

 private:
  /// Must not throw: it runs before main, or while a plug-in is loaded.
  void add(Entry entry) {
    ++registrations().count;
    if (std::any_of(entries_.begin(), entries_.end(), [&](const Entry& known) { return known.name == entry.name; }))
      registrations().taken.push_back(entry.name);
    else
      entries_.push_back(std::move(entry));
  }

  std::vector<Entry> entries_;
};

}  // namespace citylearn
