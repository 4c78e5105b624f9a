// SPDX-License-Identifier: Apache-2.0
#include <fstream>

#include "core/recording/mcap.h"
#include "core/recording/wire_header.h"
#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"

namespace citylearn::fuzz {

bool mcap_file(Input input) {
  static const testing::Folder folder;
  static const std::string path = folder / "x.mcap";
  {
    std::ofstream file(path, std::ios::binary | std::ios::trunc);
    file.write(reinterpret_cast<const char*>(input.data()), static_cast<std::streamsize>(input.size()));
  }
  bool whole = false;
  const bool good = accepted([&] {
    McapReader reader(path);
    Bytes renamed;
    while (const auto message = reader.next()) {
      require(message->data.size() <= McapReader::kMaxRecordBytes, "a message is within its record");
      require(message->channel != nullptr, "a message has a channel");
      const auto header = header_of(message->data);
      require(header.has_value() == with_session(message->data, "another", renamed), "what has a header has a run");
      if (!header) continue;
      const auto again = header_of(renamed);
      require(again && again->session == "another" && again->sender == header->sender &&
                  again->incarnation == header->incarnation && again->message == header->message,
              "another run changes nothing else");
    }
    require(!reader.next(), "the end stays the end");
    whole = reader.missing().empty();
  });
  return good && whole;
}

}  // namespace citylearn::fuzz
