// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor/findings.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/exchange/service_state.h"
#include "core/util/ipv4.h"
#include "core/util/text.h"
#include "core/util/wall_clock.h"
#include "core/wire/service.h"

namespace citylearn::doctor {
namespace {

constexpr int kProbeTimeout = 3500;     // ms: a host refuses once a second, and is asked for its address three times
constexpr double kClockTolerance = 1;   // seconds
constexpr double kMaxHeartbeatAge = 5;  // seconds without a heartbeat

/// Returns the sender's clock when it sent a heartbeat: an incarnation is the microsecond it started at.
double sent_at(const msg::ServiceStatus& status) {
  return static_cast<double>(status.header().incarnation()) / 1e6 + status.uptime();
}

/// Writes the state that must not be overlooked in capitals.
const char* shown(msg::State state) { return state == msg::FAILED ? "FAILED" : name_of(state); }

MiddlewareOptions as_doctor(MiddlewareOptions options) {
  options.participant = "doctor";
  return options;
}

Clock::time_point in_seconds(double seconds) {
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// Returns what is known of a peer or discovery server at whose address no participant was heard.
std::string account_of(const std::string& peer, const std::string& address, int port, const Findings& findings) {
  const std::string ports = fmt::format("UDP ports {}..{}", findings.first_port, findings.last_port);
  // Sent from our first interface that is not a loopback.
  std::string from;
  for (const internal::Interface& each : findings.interfaces)
    if (from.empty() && findings.used.contains(each.address) && !each.address.starts_with("127.")) from = each.address;
  switch (probe(from, address, port, kProbeTimeout)) {
    case Answer::kNoHost:
      return fmt::format("peer '{}': no host answers at {} (is it up, and does --interface lead there?)", peer,
                         address);
    case Answer::kRefused:
      return fmt::format(
          "peer '{}': the host {} is up, but nothing listens on its UDP port {} (no service runs there in "
          "domain {}, or it uses another --interface)",
          peer, address, port, findings.domain);
    case Answer::kSilent:
      break;
  }
  return fmt::format(
      "peer '{}': nothing comes back from {} (a firewall between? open {} both ways; or its services do "
      "not name this host in --peers, or are secured otherwise)",
      peer, address, ports);
}

void look_at_peers(const MiddlewareOptions& options, Findings& findings) {
  const auto heard_at = [&](const std::string& address) {
    return std::any_of(findings.participants.begin(), findings.participants.end(), [&](const auto& participant) {
      return std::find(participant.addresses.begin(), participant.addresses.end(), address) !=
             participant.addresses.end();
    });
  };
  for (const auto& [list, standard] :
       {std::pair{&options.peers, findings.first_port}, {&options.discovery_servers, internal::kDiscoveryServerPort}})
    for (const std::string& peer : *list) {
      const std::string host = peer.starts_with("dns:") ? peer.substr(4) : peer;
      const std::size_t colon = host.rfind(':');
      const int port = colon == std::string::npos ? standard : std::atoi(host.c_str() + colon + 1);
      for (const std::string& address : find_ipv4(host.substr(0, colon)).addresses)
        if (!address.starts_with("127.") && !findings.used.contains(address) && !heard_at(address))
          findings.problems.push_back(account_of(peer, address, port, findings));
    }
}

void look_at_services(Findings& findings) {
  for (const Heartbeats::Service& service : findings.services) {
    const msg::ServiceStatus& status = service.newest;
    const std::string who = fmt::format("service '{}' of session '{}'", status.header().sender().c_str(),
                                        status.header().session().c_str());
    if (status.service_state() == msg::FAILED)
      findings.problems.push_back(fmt::format("{}: FAILED: {}", who, status.activity().c_str()));
    if (*status.alarm().c_str()) findings.problems.push_back(fmt::format("{}: {}", who, status.alarm().c_str()));
    if (service.heard > 1 && std::abs(service.ahead) > kClockTolerance)
      findings.hints.push_back(
          fmt::format("the clock of '{}' was {:.1f} s {} ours when {} started (synchronise both by NTP, or the times "
                      "in logs and records do not agree)",
                      status.host().c_str(), std::abs(service.ahead), service.ahead > 0 ? "ahead of" : "behind",
                      status.header().sender().c_str()));
  }
}

/// Makes the doctor look at all topics of services, also at those of single services that were discovered.
void expect_topics(DiscoveryMonitor& discovery) {
  std::map<std::string, Topic> known;
  for (const Topic& topic : all_topics()) known[topic.name] = topic;
  std::map<std::string, Topic> expected = known;
  for (const DiscoveryMonitor::Endpoint& endpoint : discovery.endpoints())
    if (const auto base = known.find(base_topic(endpoint.topic));
        base != known.end() && endpoint.topic.starts_with("citylearn/")) {
      Topic& topic = expected[endpoint.topic] = base->second;
      topic.name = endpoint.topic;
    }
  for (const auto& [name, topic] : expected)
    for (const bool writes : {true, false}) discovery.register_local_topic(topic, writes);
}

}  // namespace

Heartbeats::Heartbeats(Middleware& middleware)
    : subscription_(middleware.create_subscription(topic_of<msg::ServiceStatus>())) {}

void Heartbeats::take() {
  while (subscription_->take(buffer_)) {
    try {
      decode(std::span<const std::byte>(buffer_), status_);
    } catch (const Error& error) {
      unreadable_.insert(error.what());
      continue;
    }
    Service& service = services_[{status_.header().session().to_string(), status_.header().sender().to_string()}];
    const auto &known = service.newest.header(), &header = status_.header();
    if (service.heard > 0 && header.incarnation() == known.incarnation() && header.message() <= known.message())
      continue;
    // A late heartbeat seems to come from a clock that is behind, so the least late one is the best estimate.
    const double ahead = sent_at(status_) - seconds_since_epoch();
    const bool again = service.heard > 0 && header.incarnation() == known.incarnation();
    service.ahead = again ? std::max(service.ahead, ahead) : ahead;
    service.heard = again ? service.heard + 1 : 1;
    service.newest = status_;
  }
}

Findings examine(const MiddlewareOptions& options, const std::string& session, double seconds) {
  Findings findings;
  findings.interfaces = internal::interfaces();
  for (const std::string& wanted : options.interfaces)
    for (const internal::Interface& each : findings.interfaces)
      if (wanted == each.name || wanted == each.address) findings.used.insert(each.address);
  findings.domain = options.domain;
  findings.first_port = internal::discovery_port(options.domain, 0);
  findings.last_port = internal::discovery_port(options.domain, internal::kParticipants - 1) + 1;

  std::unique_ptr<Middleware> middleware = create_middleware(as_doctor(options));
  findings.middleware = middleware->name();
  expect_topics(middleware->discovery());
  std::optional<Heartbeats> heard(std::in_place, *middleware);
  Heartbeats& heartbeats = *heard;
  for (const Clock::time_point deadline = in_seconds(seconds); Clock::now() < deadline && !stop_requested();) {
    middleware->wait(std::min(deadline, Clock::now() + std::chrono::milliseconds(100)));
    middleware->discovery();  // takes in what discovery finds
    heartbeats.take();
  }

  expect_topics(middleware->discovery());
  findings.participants = middleware->discovery().participants();
  findings.ports = ports_taken(findings.first_port, findings.last_port, getpid());
  for (const auto& [name, service] : heartbeats.services())
    if (session.empty() || name.first == session) findings.services.push_back(service);
  if (findings.participants.empty())
    findings.problems.push_back(fmt::format(
        "no participant was heard in domain {} on {} within {} s (same --domain, --interface and --peers there?)",
        options.domain, joined(options.interfaces), seconds));
  else if (findings.services.empty())
    findings.problems.push_back(fmt::format(
        "participants are heard, but no service{} (do they hear this host? their --peers must name it, and a "
        "firewall may let packets through one way only)",
        session.empty() ? "" : " of session '" + session + "'"));
  for (const std::string& fault : middleware->discovery().faults())
    if (!fault.starts_with("peer ")) findings.problems.push_back(fault);  // peers are examined below, more closely
  for (const std::string& line : heartbeats.unreadable()) findings.problems.push_back(line);
  heard.reset();
  middleware.reset();  // its own requests to peers would use up their answers
  look_at_peers(options, findings);
  look_at_services(findings);
  if (findings.ports.size() + 2 >= 2 * internal::kParticipants)
    findings.hints.push_back(
        fmt::format("domain {} has no more room on this host: {} participants (other sessions may have "
                    "another --domain)",
                    options.domain, internal::kParticipants));
  for (const std::string& line : internal::ForeignVariables::found()) findings.hints.push_back(line);
  for (const Limit& limit : limits_too_small())
    findings.hints.push_back(fmt::format("{} is {}: {} (sudo sysctl -w {}={})", limit.name, limit.value, limit.why,
                                         limit.name, limit.wanted));
  return findings;
}

std::string as_text(const Findings& findings) {
  std::string text = "interfaces\n";
  for (const internal::Interface& each : findings.interfaces)
    text += fmt::format("  {:<15} {:<15} packets of {} bytes{}{}\n", each.name, each.address, each.packet,
                        each.up ? "" : ", down", findings.used.contains(each.address) ? "  <- used" : "");
  text +=
      fmt::format("middleware\n  {}, domain {}: UDP ports {}..{}, {} of them taken by others here\n",
                  findings.middleware, findings.domain, findings.first_port, findings.last_port, findings.ports.size());
  for (const Port& port : findings.ports)
    text += fmt::format("  {} {}\n", port.number,
                        port.process ? fmt::format("{} (process {})", port.program, port.process)
                                     : "a process that this user may not see");
  text += fmt::format("participants: {}\n", findings.participants.size());
  for (const auto& each : findings.participants)
    text += fmt::format("  {:<24} {:<12} {}\n", each.name.empty() ? "(no name)" : each.name, each.vendor,
                        joined(each.addresses));
  text += fmt::format("services: {}\n", findings.services.size());
  for (const Heartbeats::Service& service : findings.services) {
    const msg::ServiceStatus& status = service.newest;
    // Names and activities are what others say.
    text += one_line(fmt::format(
                "  {:<24} {:<16} session {}, host {}, process {}, {}: {}{}", status.header().sender().c_str(),
                status.service().c_str(), status.header().session().c_str(), status.host().c_str(), status.process(),
                shown(status.service_state()), status.activity().c_str(),
                status.foreign() ? fmt::format(" ({} messages of other sessions)", status.foreign()) : "")) +
            "\n";
  }
  for (const std::string& hint : findings.hints) text += one_line("hint: " + hint) + "\n";
  for (const std::string& problem : findings.problems) text += one_line("PROBLEM: " + problem) + "\n";
  if (findings.problems.empty()) text += "no problems\n";
  return text;
}

std::string as_json(const Findings& findings) {
  using Json = nlohmann::ordered_json;
  Json json = {{"middleware", findings.middleware}, {"domain", findings.domain},   {"first_port", findings.first_port},
               {"last_port", findings.last_port},   {"interfaces", Json::array()}, {"ports", Json::array()},
               {"participants", Json::array()},     {"services", Json::array()},   {"hints", findings.hints},
               {"problems", findings.problems}};
  for (const internal::Interface& each : findings.interfaces)
    json["interfaces"].push_back({{"name", each.name},
                                  {"address", each.address},
                                  {"packet", each.packet},
                                  {"up", each.up},
                                  {"used", findings.used.contains(each.address)}});
  for (const Port& port : findings.ports)
    json["ports"].push_back({{"port", port.number}, {"process", port.process}, {"program", port.program}});
  for (const auto& each : findings.participants)
    json["participants"].push_back({{"name", each.name}, {"vendor", each.vendor}, {"addresses", each.addresses}});
  for (const Heartbeats::Service& service : findings.services) {
    const msg::ServiceStatus& status = service.newest;
    json["services"].push_back({{"id", status.header().sender().c_str()},
                                {"service", status.service().c_str()},
                                {"session", status.header().session().c_str()},
                                {"host", status.host().c_str()},
                                {"process", status.process()},
                                {"middleware", status.middleware().c_str()},
                                {"state", shown(status.service_state())},
                                {"activity", status.activity().c_str()},
                                {"alarm", status.alarm().c_str()},
                                {"rejected", status.rejected()},
                                {"foreign", status.foreign()},
                                {"clock_ahead", service.ahead}});
  }
  // Names and texts came over the wire: what is not UTF-8 in them is replaced.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string check_service(const MiddlewareOptions& options, const std::string& session, const std::string& id,
                          double seconds) {
  const auto middleware = create_middleware(as_doctor(options));
  Heartbeats heartbeats(*middleware);
  const auto say = [&](const std::string& what) {
    return fmt::format("service '{}'{}: {}", id, session.empty() ? "" : " of session '" + session + "'", what);
  };
  std::string trouble = fmt::format("no heartbeat within {} s", seconds);
  for (const Clock::time_point deadline = in_seconds(seconds); Clock::now() < deadline && !stop_requested();) {
    middleware->wait(deadline);
    heartbeats.take();
    for (const auto& [name, service] : heartbeats.services()) {
      if (name.second != id || (!session.empty() && name.first != session)) continue;
      const msg::ServiceStatus& status = service.newest;
      // The first heartbeat may be the last one of a process that hangs: its middleware repeats it to new readers.
      if (service.heard == 1 && std::abs(service.ahead) > kMaxHeartbeatAge) {
        trouble = "only an old heartbeat was heard: it hangs";
      } else if (status.service_state() == msg::FAILED) {
        trouble = fmt::format("FAILED: {}", status.activity().c_str());
      } else {
        return "";
      }
    }
  }
  return say(trouble);
}

}  // namespace citylearn::doctor
