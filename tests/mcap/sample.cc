// SPDX-License-Identifier: Apache-2.0
// mcap_sample FILE.mcap: a recording of every message of idl/, and FILE.mcap.json, which says what is in it.
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "core/util/error.h"
#include "core/util/version.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/samples.h"

namespace {

using namespace citylearn;
using namespace citylearn::testing;

std::string hex_of(const Bytes& bytes) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const std::byte byte : bytes) {
    text += kDigits[std::to_integer<int>(byte) >> 4];
    text += kDigits[std::to_integer<int>(byte) & 15];
  }
  return text;
}

template <class Message>
nlohmann::json fields_of(const Message& message) {
  nlohmann::json fields = nlohmann::json::object();
  if constexpr (requires { message.service_state(); }) fields["activity"] = message.activity().c_str();
  if constexpr (requires { message.choice(); }) {
    std::string choices;
    for (const std::uint8_t choice : message.choice()) choices += (choices.empty() ? "" : ",") + std::to_string(choice);
    fields["choice"] = choices;
  }
  if constexpr (requires { message.item(); }) fields["item"] = std::to_string(message.item());
  return fields;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error("needs FILE.mcap");
  McapWriter::Options options;
  options.library = "citylearn " + version();
  options.about = {{"run", "demo"}};
  options.chunk_bytes = 4096;
  Tape tape(argv[1], options);
  nlohmann::json messages = nlohmann::json::array();
  std::set<std::string> types;  // fewer than topics
  std::uint64_t time = 1'700'000'000'000'000'000;
  for (const Size size : {Size::kMin, Size::kTypical})
    for_each_message([&]<class Message>() {
      const Message message = sample_of<Message>(size);
      tape.say(message, ++time);
      types.insert(topic_of<Message>().type);
      messages.push_back({{"topic", topic_of<Message>().name},
                          {"type", topic_of<Message>().type},
                          {"time", std::to_string(time)},
                          {"data", hex_of(encoded(message))},
                          {"run", message.header().session().c_str()},
                          {"sender", message.header().sender().c_str()},
                          {"incarnation", std::to_string(message.header().incarnation())},
                          {"fields", fields_of(message)}});
    });
  std::ofstream(std::string(argv[1]) + ".json") << nlohmann::json{{"messages", messages}, {"types", types.size()}};
} catch (const std::exception& error) {
  std::cerr << "mcap_sample: " << error.what() << "\n";
  return 1;
}
