// SPDX-License-Identifier: Apache-2.0
#include "core/wire/messenger.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>

#include "core/exchange/timing.h"
#include "core/util/machine.h"
#include "core/util/name.h"
#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

MiddlewareOptions named(MiddlewareOptions options, const std::string& id) {
  if (options.participant.empty()) options.participant = id;
  return options;
}

void require_name(const std::string& value, const std::string& where) {
  if (const std::string problem = name_problem(value); !problem.empty()) throw Error(problem, where);
}

/// Returns the options once their names are checked.
const NodeOptions& checked(const NodeOptions& options) {
  require_name(options.id, "id");
  if (!options.session.empty()) require_name(options.session, "session");
  return options;
}

/// Returns the time, another one at each start. Its last 4 ms distinguish services that start at the same moment, as
/// those of one script do, because the incarnation alone says which service serves which. Processes of one host differ
/// by number, those of containers, which all have the same one, by host or id.
std::uint64_t new_incarnation(const std::string& id) {
  constexpr std::uint64_t kProcesses = 64, kServices = 64, kSlots = kProcesses * kServices;
  const std::uint64_t own = std::hash<std::string>{}(host_name() + " " + id) % kServices * kProcesses +
                            static_cast<std::uint64_t>(process_number()) % kProcesses;
  if (Machine::simulated()) return microseconds_since_epoch() / kSlots * kSlots + own;  // `last` is of one process
  static std::atomic<std::uint64_t> last{0};
  std::uint64_t before = last, next = 0;
  do {
    const std::uint64_t moment = std::max(microseconds_since_epoch() / kSlots, before / kSlots + 1);
    next = moment * kSlots + own;
  } while (!last.compare_exchange_weak(before, next));
  return next;
}

}  // namespace

Messenger::Messenger(const NodeOptions& options)
    : options_(checked(options)),
      incarnation_(new_incarnation(options_.id)),
      middleware_(create_middleware(named(options_.middleware, options_.id))) {}

Messenger::~Messenger() {
  // Otherwise one lost packet would be enough to lose the last messages.
  const Clock::time_point deadline = Clock::now() + kFlushTimeout;
  for (auto& [topic, channels] : channels_) channels.wait_for_acknowledgments(deadline);
}

void Messenger::release_topics(const std::string& id) {
  for (auto& [topic, channels] : channels_) channels.release_topics(at(id));
}

void Messenger::delete_idle_writers(Clock::time_point now) {
  for (auto& [topic, channels] : channels_) channels.delete_idle_writers(now);
}

void Messenger::stamp(msg::Header& header, const std::string& session) const {
  header.protocol(msg::PROTOCOL);
  header.session(session.empty() ? options_.session : session);
  header.sender(options_.id);
  header.incarnation(incarnation_);
}

bool Messenger::accept(const msg::Header& header) {
  if (!options_.session.empty() && header.session() != options_.session) {
    ++traffic.foreign;
    return false;
  }
  const bool other = header.incarnation() != incarnation_ || header.sender() != options_.id;
  if (other) ++traffic.received;
  return other;
}

void Messenger::reject(const Error& error) {
  ++traffic.rejected;
  // Logged once per type and field: a peer that sends wrong messages sends many of them.
  const std::string line = error.what();
  if (rejected_.insert(line.substr(0, line.find(": "))).second)
    spdlog::warn("rejected a message: {} (more of the kind are counted, not logged)", line);
}

}  // namespace citylearn
