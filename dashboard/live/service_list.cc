// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/service_list.h"

#include <algorithm>
#include <cstring>

#include "core/exchange/service_state.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

Event event_of(const msg::ServiceStatus& status, const char* kind, const std::string& text) {
  return {seconds_since_epoch(), status.header().session().c_str(), status.header().sender().c_str(), kind, text};
}

std::string where(const msg::ServiceStatus& status) {
  return std::string(status.service().c_str()) + " on " + status.host().c_str() + ", process " +
         std::to_string(status.process());
}

}  // namespace

bool ServiceList::set(Service& service, const char* state) {
  if (std::strcmp(service.state, state) == 0) return false;
  service.state = state;
  service.since = seconds_since_epoch();
  return true;
}

void ServiceList::on_message(const msg::ServiceStatus& status, Clock::time_point now, std::vector<Event>& events) {
  const std::pair key(std::string(status.header().session().c_str()), std::string(status.header().sender().c_str()));
  const auto [entry, first] = services_.try_emplace(key);
  Service& service = entry->second;
  const std::uint64_t before = service.status.header().incarnation(), is = status.header().incarnation();
  if (service.presence.hear(is, now) == Incumbent::Heard::kOther) return;
  const std::string state = service.state;
  if (first) {
    service.since = seconds_since_epoch();
    events.push_back(event_of(status, "started", where(status)));
  } else if (is != before) {
    events.push_back(event_of(status, "restarted", where(status)));
  } else if (service.silent) {
    events.push_back(event_of(status, "back", "heartbeats arrive again"));
  }
  const bool failed = status.service_state() == msg::FAILED;
  if (failed && (state != "failed" || is != before))
    events.push_back(event_of(status, "failed", status.activity().c_str()));
  // An alarm of the first heartbeat counts; a restarted process does not inherit its predecessor's alarm.
  if (const std::string alarm = status.alarm().c_str(), earlier = is == before ? service.status.alarm().c_str() : "";
      alarm != earlier)
    events.push_back(event_of(status, "alarm", alarm.empty() ? "resolved: " + earlier : alarm));
  if (status.service_state() == msg::STOPPING) service.presence.leave();
  service.status = status;
  service.silent = false;
  set(service, name_of(status.service_state()));
  if (services_.size() <= kMaxServices) return;
  const auto oldest = std::min_element(services_.begin(), services_.end(), [](const auto& a, const auto& b) {
    return a.second.presence.last_heard() < b.second.presence.last_heard();
  });
  services_.erase(oldest);
}

bool ServiceList::poll(Clock::time_point now, std::vector<Event>& events) {
  bool changed = std::erase_if(services_, [&](const auto& entry) {
                   return now - entry.second.presence.last_heard() > kRemovalDelay;
                 }) > 0;
  for (auto& [key, service] : services_) {
    if (service.silent || service.presence.here(now)) continue;
    service.silent = true;
    changed = true;
    const msg::State last = service.status.service_state();
    if (last == msg::FAILED) continue;  // was reported
    const bool announced = last == msg::STOPPING;
    set(service, announced ? "stopped" : "lost");
    events.push_back(
        announced ? event_of(service.status, "stopped", where(service.status))
                  : event_of(service.status, "lost", "no heartbeat for " + std::to_string(kSilence.count()) + " s"));
  }
  return changed;
}

bool ServiceList::is_alive(const std::string& session, const std::string& id) const {
  const auto found = services_.find({session, id});
  return found != services_.end() && !found->second.silent;
}

bool ServiceList::is_working(const std::string& session, const std::string& id) const {
  const auto found = services_.find({session, id});
  return found != services_.end() && found->second.status.service_state() == msg::RUNNING;
}

nlohmann::json ServiceList::json(Clock::time_point now) const {
  Json services = Json::array();
  for (const auto& [key, service] : services_) {
    const msg::ServiceStatus& status = service.status;
    services.push_back({{"id", key.second},
                        {"service", status.service().c_str()},
                        {"session", key.first},
                        {"host", status.host().c_str()},
                        {"process", status.process()},
                        {"middleware", status.middleware().c_str()},
                        {"incarnation", status.header().incarnation()},
                        {"state", service.state},
                        {"activity", status.activity().c_str()},
                        {"uptime", status.uptime()},
                        {"rate", status.rate()},
                        {"age", std::chrono::duration<double>(now - service.presence.last_heard()).count()},
                        {"processors", status.processors()},
                        {"memory", status.memory()},
                        {"sent_bytes", status.sent_bytes()},
                        {"received_bytes", status.received_bytes()},
                        {"received", status.received()},
                        {"repeated", status.repeated()},
                        {"resent", status.resent()},
                        {"rejected", status.rejected()},
                        {"foreign", status.foreign()},
                        {"alarm", status.alarm().c_str()},
                        {"since", service.since}});
  }
  return {{"now", seconds_since_epoch()}, {"services", services}};
}

}  // namespace citylearn
