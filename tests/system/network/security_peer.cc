// SPDX-License-Identifier: Apache-2.0
// security_peer MIDDLEWARE DOMAIN FOLDER NAME WRITES READS: a participant with the keys in FOLDER (none: "") that
// nobody has checked, so that what protects is the wire alone. Writes its name to the topic WRITES ("" for none) fifty
// times a second ("NAME has heard" once something came) and reads READS, until its standard input ends. Exit status: 0
// when nothing came, 3 when something did, 4 when the vendor did not let it begin.
#include <spdlog/spdlog.h>

#include <cstdio>

#include "core/dds/middleware_internal.h"
#include "core/util/error.h"
#include "tests/support/processes/peer.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxSize = 1024;

int run(char** arguments) {
  internal::Network network{};
  const std::string vendor = arguments[1];
  network.domain = static_cast<std::uint32_t>(std::stoul(arguments[2]));
  network.security = arguments[3];
  network.participant = arguments[4];
  const std::string writes = arguments[5], reads = arguments[6];
  network.interfaces = "lo";
  network.addresses = {"127.0.0.1"};
  network.loopback_only = true;
  network.datagram = 65500;
  network.peers = {{"lo", "127.0.0.1", 0}};
  std::unique_ptr<Middleware> middleware;
  std::unique_ptr<Publisher> publisher;
  std::unique_ptr<Subscription> subscription;
  try {
    middleware = vendor == "fastdds" ? internal::create_fastdds(network) : internal::create_cyclonedds(network);
    if (!reads.empty()) subscription = middleware->create_subscription({reads, "Text", Profile::kCommand, kMaxSize});
    if (!writes.empty()) publisher = middleware->create_publisher({writes, "Text", Profile::kCommand, kMaxSize});
  } catch (const Error& error) {
    std::fprintf(stderr, "%s: %s\n", arguments[4], error.what());
    return 4;
  }
  const auto encoded = [](const std::string& said) {
    Bytes text(4 + said.size());
    text[1] = std::byte{1};
    std::copy_n(reinterpret_cast<const std::byte*>(said.data()), said.size(), text.begin() + 4);
    return text;
  };
  Bytes taken;
  bool received = false;
  while (!testing::input_ended()) {
    if (publisher) publisher->publish(encoded(network.participant + (received ? " has heard" : "")));
    const Clock::time_point next = Clock::now() + std::chrono::milliseconds(20);
    while (middleware->wait(next))
      while (subscription && subscription->take(taken)) received = true;
    for (const std::string& fault : middleware->discovery().faults()) spdlog::error("{}", fault);
  }
  return received ? 3 : 0;
}

}  // namespace
}  // namespace citylearn

int main(int count, char** arguments) { return citylearn::testing::peer_main(6, count, arguments, citylearn::run); }
