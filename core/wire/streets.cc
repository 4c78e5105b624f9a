// SPDX-License-Identifier: Apache-2.0
#include "core/wire/streets.h"

#include "core/util/error.h"
#include "core/wire/messages.h"

namespace citylearn {

Bytes encode_streets(const StreetMap& map) {
  msg::Streets streets;
  streets.east() = map.east;
  streets.north() = map.north;
  streets.source() = map.from;
  streets.target() = map.to;
  streets.heading() = map.heading;
  return encode_object(streets);
}

StreetMap decode_streets(const Bytes& bytes, std::optional<std::uint64_t> hash) {
  const auto streets = decode_object<msg::Streets>(bytes);
  StreetMap map{streets.east(), streets.north(), streets.source(), streets.target(), streets.heading()};
  map.check();
  if (hash && map.hash() != *hash) throw Error("is another one than was announced", "street map");
  return map;
}

}  // namespace citylearn
