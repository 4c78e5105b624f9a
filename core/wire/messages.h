// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <concepts>
#include <span>
#include <string>

#include "core/dds/middleware.h"
#include "core/task/action.h"
#include "core/util/error.h"
#include "idl/action.h"
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

/// Returns the topic of a message type. Defined for every message of idl/ (messages.cc); other types do not link.
template <class Message>
const Topic& topic_of();

/// Writes the CDR bytes of a message into `bytes` (its capacity is used again). Throws Error when a sequence is over
/// its bound.
template <class Message>
void encode(const Message& message, Bytes& bytes);

/// Reads a message from CDR bytes. Throws Error that names the type and the field when the bytes are cut short, another
/// protocol, over a bound, an unknown enumerator, or sequences that should be of one length are not. Never allocates
/// for more elements than the bytes can hold.
template <class Message>
void decode(std::span<const std::byte> bytes, Message& message);

/// Returns every topic of the project, for tools and tests.
std::vector<Topic> all_topics();

}  // namespace citylearn
