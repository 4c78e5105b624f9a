// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <concepts>
#include <span>
#include <string>
#include <vector>

#include "core/dds/middleware.h"
#include "core/task/action.h"
#include "core/util/error.h"
#include "idl/action.h"
#include "idl/descriptor.h"
#include "idl/episode.h"
#include "idl/image.h"
#include "idl/observation.h"
#include "idl/scene.h"
#include "idl/status.h"
#include "idl/task_settings.h"
#include "idl/training.h"
#include "idl/trajectory.h"
#include "idl/traversal.h"

namespace citylearn {

/// Returns the topic of all of a message type; those of single services are topic_at(). Defined for every message of
/// idl/ (messages.cc); other types do not link.
template <class Message>
const Topic& topic_of();

/// On which topics messages of a type are sent (idl/generate.py), so that a message reaches only services that need it.
enum class Addressing {
  kAll,           ///< that of all
  kReceiver,      ///< that of the service that the message names; that of all if it names none
  kSender,        ///< that of the service that sends it
  kSenderAndAll,  ///< both
};
template <class Message>
Addressing addressing_of();
Addressing addressing_of(const Topic& topic);

/// On whose topic: a service of a session, or all, where both are empty.
struct Address {
  std::string session, id;
  auto operator<=>(const Address&) const = default;
};
/// Returns on whose topics a message is sent; the first one numbers it (Header.message).
template <class Message>
std::vector<Address> addresses_of(const Message& message);

/// Returns the topic of one service, "citylearn/SESSION/ID/action", for `topic`, "citylearn/action". That of a service
/// that hears all sessions is "citylearn/ID/action". Cyclone DDS allows letters, digits, '_' and '/' alone in it, so
/// '-' of a name becomes "_m", '.' "_d" and '_' "_u"; what is very long ends in a hash.
Topic topic_at(const Topic& topic, const std::string& session, const std::string& id);
/// Returns "citylearn/action" for the name of any topic of actions.
std::string base_topic(const std::string& name);
/// Returns the topics on which a message of this kind was sent, by its bytes. Throws Error as decode().
std::vector<Topic> topics_of(const Topic& topic, std::span<const std::byte> bytes);

/// Writes the CDR bytes of a message into `bytes` (its capacity is used again). Throws Error when a sequence is over
/// its bound.
template <class Message>
void encode(const Message& message, Bytes& bytes);

/// Reads a message from CDR bytes. Throws Error that names the type and the field when the bytes are cut short, another
/// protocol, over a bound, an unknown enumerator, or sequences that should be of one length are not. Never allocates
/// for more elements than the bytes can hold.
template <class Message>
void decode(std::span<const std::byte> bytes, Message& message);

/// Returns the topic of all of every message type, for tools and tests.
std::vector<Topic> all_topics();

}  // namespace citylearn
