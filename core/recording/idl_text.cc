// SPDX-License-Identifier: Apache-2.0
#include "core/recording/idl_text.h"

#include <set>
#include <string_view>
#include <utility>

#include "core/util/error.h"

namespace citylearn {
namespace {

/// Name and text of each file of idl/; made by the build.
constexpr std::pair<std::string_view, std::string_view> kFiles[] = {
#include "core/recording/idl_files.inc"
};

std::string_view text_of(std::string_view name) {
  for (const auto& [file, text] : kFiles)
    if (file == name) return text;
  throw Error("is included and not there", "idl/" + std::string(name));
}

/// Appends a file once, after those that it includes.
void append(std::string_view name, std::set<std::string_view>& done, std::string& to) {
  if (!done.insert(name).second) return;
  constexpr std::string_view kInclude = "#include \"";
  std::string own;
  for (std::string_view text = text_of(name); !text.empty();) {
    const std::string_view line = text.substr(0, text.find('\n') + 1);
    text.remove_prefix(line.empty() ? text.size() : line.size());
    if (line.starts_with(kInclude)) {
      const std::string_view rest = line.substr(kInclude.size());
      append(rest.substr(0, rest.find('"')), done, to);
    } else {
      own += line;
    }
  }
  to += own;
}

}  // namespace

std::string idl_of(const std::string& type) {
  const std::string start = "@final struct " + type.substr(type.rfind(':') + 1) + " {";
  for (const auto& [file, text] : kFiles) {
    if (text.find(start) == text.npos) continue;
    std::set<std::string_view> done;
    std::string all;
    append(file, done, all);
    return all;
  }
  throw Error("is defined nowhere in idl/", type);
}

}  // namespace citylearn
