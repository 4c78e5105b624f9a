// SPDX-License-Identifier: Apache-2.0
#include "core/wire/node.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>

#include "core/dds/security.h"
#include "core/util/machine.h"
#include "core/util/name.h"
#include "core/util/wall_clock.h"
#include "core/wire/presence.h"

namespace citylearn {
namespace {

constexpr std::chrono::seconds kHeartbeat{1};
constexpr double kNew = 10;          // seconds in which a process gives way to another one with its id
constexpr double kSameMoment = 0.1;  // seconds between two starts that count as one
constexpr std::chrono::milliseconds kLastMessages{500};  // for readers that do not acknowledge

MiddlewareOptions named(MiddlewareOptions options, const std::string& id) {
  if (options.participant.empty()) options.participant = id;
  return options;
}

void require_name(const std::string& value, const std::string& where) {
  if (const std::string problem = name_problem(value); !problem.empty()) throw Error(problem, where);
}

/// Returns the time, another one at each start. Its last 4 ms distinguish services that start at the same moment, as
/// those of one script do, because the incarnation alone says which service serves which. Processes of one host differ
/// by number, those of containers, which all have the same one, by host or id.
std::uint64_t new_incarnation(const std::string& id) {
  constexpr std::uint64_t kProcesses = 64, kServices = 64, kAtOnce = kProcesses * kServices;
  const std::uint64_t own = std::hash<std::string>{}(host_name() + " " + id) % kServices * kProcesses +
                            static_cast<std::uint64_t>(process_number()) % kProcesses;
  if (Machine::simulated()) return microseconds_since_epoch() / kAtOnce * kAtOnce + own;  // `last` is of one process
  static std::atomic<std::uint64_t> last{0};
  std::uint64_t before = last, next = 0;
  do {
    const std::uint64_t moment = std::max(microseconds_since_epoch() / kAtOnce, before / kAtOnce + 1);
    next = moment * kAtOnce + own;
  } while (!last.compare_exchange_weak(before, next));
  return next;
}

}  // namespace

Node::Node(Options options) : options_(std::move(options)), incarnation_(new_incarnation(options_.id)) {
  require_name(options_.id, "id");
  if (!options_.session.empty()) require_name(options_.session, "session");
  middleware_ = create_middleware(named(options_.middleware, options_.id));
  started_ = next_heartbeat_ = Clock::now();
  status_.service(options_.service);
  status_.host(host_name());
  status_.middleware(middleware_->name());
  status_.process(static_cast<std::uint32_t>(process_number()));
  status_.service_state(msg::STARTING);
  create_writer<msg::ServiceStatus>();
}

Node::~Node() {
  // Otherwise one lost packet would be enough to lose the last messages.
  const Clock::time_point deadline = Clock::now() + kLastMessages;
  for (const auto& [topic, channel] : channels_)
    if (channel.publisher) channel.publisher->wait_for_acknowledgments(deadline);
  channels_.clear();  // before the middleware they belong to
}

Node::Channel& Node::publisher(const Topic& topic) {
  Channel& channel = channels_[&topic];
  if (!channel.publisher) channel.publisher = middleware_->create_publisher(topic);
  return channel;
}

Node::Channel& Node::subscription(const Topic& topic) {
  Channel& channel = channels_[&topic];
  if (!channel.subscription) channel.subscription = middleware_->create_subscription(topic);
  return channel;
}

void Node::stamp(msg::Header& header, const std::string& session, std::uint64_t number) const {
  header.protocol(msg::PROTOCOL);
  header.session(session.empty() ? options_.session : session);
  header.sender(options_.id);
  header.incarnation(incarnation_);
  header.message(number);
}

bool Node::accept(const msg::Header& header) {
  if (!options_.session.empty() && header.session() != options_.session) {
    ++traffic.foreign;
    return false;
  }
  const bool other = header.incarnation() != incarnation_ || header.sender() != options_.id;
  if (other) ++traffic.received;
  return other;
}

void Node::reject(const Error& error) {
  ++traffic.rejected;
  // Logged once per type and field: a peer that sends wrong messages sends many of them.
  const std::string line = error.what();
  if (rejected_.insert(line.substr(0, line.find(": "))).second)
    spdlog::warn("rejected a message: {} (more of the kind are counted, not logged)", line);
}

void Node::heartbeat() {
  const Clock::time_point now = Clock::now();
  next_heartbeat_ = now + kHeartbeat;
  if (now - twin_heard_ >= kSilence) alarm("id", "");
  if (const std::string& keys = options_.middleware.security; !keys.empty())
    alarm("security", internal::outdated_revocations(keys, incarnation_));
  status_.uptime(std::chrono::duration<double>(now - started_).count());
  status_.received(traffic.received);
  status_.repeated(traffic.repeated);
  status_.resent(traffic.resent);
  status_.rejected(traffic.rejected);
  status_.foreign(traffic.foreign);
  publish(status_);
}

Clock::time_point Node::publish_heartbeat_if_due() {
  if (Clock::now() >= next_heartbeat_) heartbeat();
  return next_heartbeat_;
}

bool Node::wait(Clock::time_point deadline) {
  while (true) {
    publish_heartbeat_if_due();
    const bool ready = middleware_->wait(std::min(deadline, next_heartbeat_));
    for (const std::string& line : middleware_->discovery().faults()) {
      spdlog::error("{}", line);
      // A peer may still come; a foreign type on our topics will not go away by waiting.
      if (line.starts_with("topic ")) faults_.push_back(line);
    }
    if (ready) return true;
    if (Clock::now() >= deadline) return false;
  }
}

void Node::report(msg::State state, const std::string& activity, float rate) {
  const bool changed = state != status_.service_state();
  status_.service_state(state);
  status_.activity(activity.substr(0, 256));
  status_.rate(rate);
  if (changed) heartbeat();
}

void Node::check_twin(const msg::ServiceStatus& status) {
  const msg::Header& header = status.header();
  if (header.sender() != options_.id || header.session() != options_.session || header.incarnation() == incarnation_ ||
      status.service_state() == msg::STOPPING || status.service_state() == msg::FAILED)
    return;
  const std::string where = std::string(status.host().c_str()) + " (process " + std::to_string(status.process()) + ")";
  const double uptime = seconds_since(started_), older = status.uptime() - uptime;
  const bool is_new = uptime < kNew && status_.service_state() != msg::RUNNING;
  if (is_new && (older > kSameMoment || (older > -kSameMoment && header.incarnation() < incarnation_)))
    throw Error("already runs in session '" + options_.session + "' on " + where, "id '" + options_.id + "'",
                "choose another --id or --session");
  twin_heard_ = Clock::now();
  if (!alarms_.contains("id")) alarm("id", "another process has the same id, on " + where + ": end one of them");
}

void Node::alarm(const std::string& what, const std::string& problem) {
  const auto known = alarms_.find(what);
  if (known == alarms_.end() ? problem.empty() : known->second == problem) return;
  if (problem.empty()) {
    alarms_.erase(known);
    spdlog::info("{}: the problem is solved", what);
  } else {
    alarms_[what] = problem;
    spdlog::error("{}: {}", what, problem);
  }
  std::string all;
  for (const auto& [name, text] : alarms_) all += (all.empty() ? "" : "; ") + name + ": " + text;
  status_.alarm(all.substr(0, 256));
  heartbeat();
}

}  // namespace citylearn
