// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/wire/node.h"
#include "tests/support/records/samples.h"

namespace citylearn::testing {

/// Creates the readers of what `sender` sends of a type, and of what is sent to the receivers that samples name.
template <class Message>
void create_readers_of_samples(Node& node, const std::string& sender) {
  if (addressing_of<Message>() == Addressing::kSender) node.create_reader_at<Message>(sender);
  if (addressing_of<Message>() != Addressing::kReceiver) return node.create_reader<Message>();
  for (const Size size : {Size::kMin, Size::kTypical, Size::kMax})
    node.create_reader_at<Message>(addresses_of(sample_of<Message>(size)).front().id);
}

}  // namespace citylearn::testing
