// SPDX-License-Identifier: Apache-2.0
// vendors_peer MIDDLEWARE DOMAIN RUN ID OTHER: reads every kind of message, of OTHER where senders have topics
// of their own, and sends each back, until its standard input ends.

#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/processes/peer.h"
#include "tests/support/records/readers.h"

namespace citylearn {
namespace {

int run(char** arguments) {
  Node node({testing::middleware_options(arguments[1], static_cast<std::uint32_t>(std::stoul(arguments[2]))),
             "vendors_peer", arguments[4], arguments[3]});
  testing::for_each_message([&]<class Message>() {
    testing::create_readers_of_samples<Message>(node, arguments[5]);
    node.create_writer<Message>();
  });
  while (!testing::input_ended()) {
    node.wait(Clock::now() + std::chrono::milliseconds(20));
    testing::for_each_message([&]<class Message>() {
      Message message;
      while (node.take(message)) node.publish(message);
    });
  }
  return node.discovery().wrong_types().empty() && node.traffic.rejected == 0 ? 0 : 1;
}

}  // namespace
}  // namespace citylearn

int main(int count, char** arguments) { return citylearn::testing::peer_main(5, count, arguments, citylearn::run); }
