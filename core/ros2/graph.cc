// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/graph.h"

#include <algorithm>

#include "core/wire/cdr.h"

namespace citylearn {

const std::vector<std::string>& ros2_distros() {
  static const std::vector<std::string> all = {"foxy",  "galactic", "humble",  "iron",
                                               "jazzy", "kilted",   "lyrical", "rolling"};
  return all;
}

std::size_t ros2_gid_bytes(const std::string& distro) {
  const auto& all = ros2_distros();
  return std::ranges::find(all, distro) < std::ranges::find(all, "iron") ? 24 : 16;
}

Bytes encode_ros2(const Ros2Node& node, std::size_t gid_bytes) {
  Bytes bytes;
  CdrWriter writer(bytes);
  bytes.reserve(1024);  // without it GCC 12 warns, wrongly, of copying from nothing
  const auto write_gid = [&](const Guid& guid) {
    writer("", guid);
    bytes.resize(bytes.size() + gid_bytes - guid.size());
  };
  write_gid(node.participant);
  writer("", std::uint32_t{1});  // nodes
  writer("", node.name_space);
  writer("", node.name);
  for (const auto* guids : {&node.readers, &node.writers}) {
    writer("", static_cast<std::uint32_t>(guids->size()));
    for (const Guid& guid : *guids) write_gid(guid);
  }
  return bytes;
}

bool has_gids_of(std::size_t gid_bytes, std::span<const std::byte> message) {
  try {
    CdrReader reader(message);
    Bytes skipped;
    const auto skip = [&](std::size_t bytes) {
      if (bytes > reader.left()) throw CdrError{"cut short"};
      skipped.resize(bytes);
      reader.read(skipped.data(), bytes);
    };
    skip(gid_bytes);
    for (std::uint32_t nodes = reader.read_length(); nodes > 0; --nodes) {
      for (int text = 0; text < 2; ++text) skip(reader.read_length());
      for (int list = 0; list < 2; ++list) skip(gid_bytes * reader.read_length());
    }
    return reader.left() < 4;  // some pad to multiples of 4
  } catch (const CdrError&) {
    return false;
  }
}

}  // namespace citylearn
