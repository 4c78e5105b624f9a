// SPDX-License-Identifier: Apache-2.0
#include "core/task/imperfections.h"

#include <spdlog/fmt/fmt.h>

#include <regex>

#include "core/util/name.h"

namespace citylearn {

std::string world_of(const Imperfections& imperfections) {
  std::string text;
  const auto add = [&](const char* what, auto amount) {
    if (amount > 0) text += fmt::format("{}{}{}", text.empty() ? "" : "-", what, amount);
  };
  add("slip", imperfections.slip);
  add("drop", imperfections.dropped_frames);
  add("kidnap", imperfections.kidnappings);
  return text;
}

std::string world_of(const std::string& traversal) {
  static const std::regex kWorld = [] {
    const std::string share = "(0\\.\\d+|\\d(\\.\\d+)?e-\\d+|1)";
    return std::regex("((-slip" + share + ")?(-drop" + share + ")?(-kidnap[1-9]\\d*)?)$");
  }();
  std::smatch found;
  std::regex_search(traversal, found, kWorld);  // finds the longest, maybe nothing at the end
  return found.length() > 0 ? found.str().substr(1) : "";
}

std::string name_in_world(const std::string& recording, const std::string& world) {
  if (world.empty()) return name_from(recording);
  // A name that is too long all the same is refused where it goes onto the wire.
  const std::size_t room = world.size() + 1 < kMaxNameLength ? kMaxNameLength - world.size() - 1 : 1;
  return name_from(recording.substr(0, room)) + "-" + world;
}

}  // namespace citylearn
