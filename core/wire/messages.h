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
#include "idl/objects.h"
#include "idl/observation.h"
#include "idl/scene.h"
#include "idl/status.h"
#include "idl/task_settings.h"
#include "idl/training.h"
#include "idl/trajectory.h"
#include "idl/traversal.h"

namespace citylearn {

/// Returns the topic of a message type that every service reads. topic_at() returns the topics of single services.
/// Defined for every message of idl/ (messages.cc); other types do not link.
template <class Message>
const Topic& topic_of();

/// The topics of a message type (idl/generate.py): a message reaches only the services that need it.
enum class Addressing {
  kSharedTopic,   ///< the topic that every service reads
  kReceiver,      ///< the topic of the service that the message names; the shared topic if it names none
  kSender,        ///< the topic of the service that sends it
  kSenderAndAll,  ///< both
};
template <class Message>
Addressing addressing_of();
Addressing addressing_of(const Topic& topic);

/// Names a topic by its service: one of a session, or all services where both are empty.
struct Address {
  std::string session, id;
  auto operator<=>(const Address&) const = default;
};
/// Returns the addresses of the topics on which a message is sent. The first one numbers it (Header.message).
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

/// Writes the CDR bytes of a message into `bytes` (capacity is reused). Throws Error when a sequence is over its bound.
template <class Message>
void encode(const Message& message, Bytes& bytes);

/// Reads a message from CDR bytes. Throws Error that names the type and the field when the bytes are cut short, another
/// protocol, over a bound, an unknown enumerator, or sequences that should be of one length are not. Never allocates
/// for more elements than the bytes can hold.
template <class Message>
void decode(std::span<const std::byte> bytes, Message& message);

/// Returns the bytes of an object (idl/object.idl), as encode() writes them.
template <class Object>
Bytes encode_object(const Object& object);
/// Reads an object from its bytes. Throws Error as decode().
template <class Object>
Object decode_object(std::span<const std::byte> bytes);

/// Returns the topic of all of every message type, for tools and tests.
std::vector<Topic> all_topics();

}  // namespace citylearn
