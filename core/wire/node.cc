// SPDX-License-Identifier: Apache-2.0
#include "core/wire/node.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/dds/security.h"
#include "core/exchange/presence.h"
#include "core/exchange/timing.h"
#include "core/util/log_format.h"

namespace citylearn {
namespace {

using Seconds = std::chrono::duration<double>;

}  // namespace

Node::Node(const Options& options) : Messenger(options), use_(process_use()), metrics_(options.metrics) {
  set_log_identity({options_.session, options_.service, options_.id});
  started_ = next_heartbeat_ = Clock::now();
  status_.service(options_.service);
  status_.host(host_name());
  status_.middleware(middleware_->name());
  status_.process(static_cast<std::uint32_t>(process_number()));
  status_.service_state(msg::STARTING);
  create_writer<msg::ServiceStatus>();
}

void Node::heartbeat() {
  const Clock::time_point now = Clock::now();
  next_heartbeat_ = now + kHeartbeat;
  if (now - twin_heard_ >= kSilence) alarm("id", "");
  if (const std::string& keys = options_.middleware.security; !keys.empty())
    alarm("security", internal::outdated_revocations(keys, incarnation_));
  const double uptime = std::chrono::duration<double>(now - started_).count();
  const ProcessUse use = process_use();
  if (uptime > status_.uptime())
    status_.processors(
        static_cast<float>((use.processor_seconds - use_.processor_seconds) / (uptime - status_.uptime())));
  use_ = use;
  status_.memory(use.resident);
  status_.sent_bytes(traffic.sent_bytes);
  status_.received_bytes(traffic.received_bytes);
  status_.uptime(uptime);
  status_.received(traffic.received);
  status_.repeated(traffic.repeated);
  status_.resent(traffic.resent);
  status_.rejected(traffic.rejected);
  status_.foreign(traffic.foreign);
  publish(status_);
  metrics_.set(status_);
}

Clock::time_point Node::publish_heartbeat_if_due() {
  if (const Clock::time_point now = Clock::now(); now >= next_heartbeat_) {
    delete_idle_writers(now);
    heartbeat();
  }
  return next_heartbeat_;
}

bool Node::wait(Clock::time_point deadline) {
  while (true) {
    publish_heartbeat_if_due();
    const bool ready = middleware_->wait(std::min(deadline, next_heartbeat_));
    for (const std::string& line : middleware_->discovery().faults()) spdlog::error("{}", line);
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
  const bool is_new = Seconds(uptime) < kTwinGrace && status_.service_state() != msg::RUNNING;
  if (is_new &&
      (Seconds(older) > kStartTolerance || (Seconds(older) > -kStartTolerance && header.incarnation() < incarnation_)))
    throw Error("already runs in session '" + options_.session + "' of domain " +
                    std::to_string(options_.middleware.domain) + " on " + where,
                "id '" + options_.id + "'", "choose another --id or --session");
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
