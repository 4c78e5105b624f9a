// SPDX-License-Identifier: Apache-2.0
#include "core/dds/discovery_monitor.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/dds/middleware.h"
#include "core/dds/middleware_internal.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr auto kReported =
    std::chrono::steady_clock::time_point::max();  // the end of waiting for a peer, once it was reported

/// A process that floods a domain with participants is reported this often, and costs no more memory.
constexpr std::size_t kMaxStrangers = 1000;

std::string quoted(const std::string& name) { return name.empty() ? "an unnamed participant" : "'" + name + "'"; }

std::string describe(const DiscoveryMonitor::Participant& participant) {
  std::string who = quoted(participant.name);
  if (!participant.vendor.empty()) who += ", " + participant.vendor;
  for (const std::string& address : participant.addresses) who += ", at " + address;
  return who;
}

/// Returns what keeps a remote endpoint and one of ours from matching, "VOLATILE, expected TRANSIENT_LOCAL", by the
/// rule of DDS 1.4, 2.2.3: a writer offers at least what a reader requests. Returns an empty text when they match.
std::string mismatch(const EndpointQos& remote, bool remote_writes, const EndpointQos& ours) {
  static constexpr const char* kReliability[] = {"BEST_EFFORT", "RELIABLE"};
  static constexpr const char* kDurability[] = {"VOLATILE", "TRANSIENT_LOCAL", "TRANSIENT", "PERSISTENT"};
  static constexpr const char* kLiveliness[] = {"AUTOMATIC", "MANUAL_BY_PARTICIPANT", "MANUAL_BY_TOPIC"};
  const EndpointQos& offered = remote_writes ? remote : ours;
  const EndpointQos& requested = remote_writes ? ours : remote;
  std::string text;
  const auto check = [&](bool match, const std::string& found, const std::string& expected) {
    if (!match) text += (text.empty() ? "" : "; ") + found + ", expected " + expected;
  };
  check(offered.reliable >= requested.reliable, kReliability[remote.reliable], kReliability[ours.reliable]);
  check(offered.durability >= requested.durability, kDurability[remote.durability], kDurability[ours.durability]);
  check(!remote.exclusive, "EXCLUSIVE", "SHARED");
  check(offered.liveliness >= requested.liveliness, kLiveliness[remote.liveliness], kLiveliness[ours.liveliness]);
  for (const auto& [name, time] : {std::pair{"liveliness lease", remote.lease}, {"deadline", remote.deadline}})
    check(remote_writes || time >= EndpointQos::kForever, fmt::format("a {} of {:g} s", name, time), "none");
  check(remote.partition.empty(), "partition '" + one_line(remote.partition) + "'", "none");
  check(remote.xcdr1, "XCDR2", "XCDR1");
  check(!remote.keyed, "a topic with a key", "one without");
  return text;
}

}  // namespace

std::string DiscoveryMonitor::name_of(const std::string& participant) const {
  const auto found = participants_.find(participant);
  return found == participants_.end() ? "" : found->second.name;
}

/// Returns "type A, expected B" or what is wrong with its quality of service; an empty text when nothing is.
std::string DiscoveryMonitor::fault_of(const Remote& remote) const {
  const auto found = local_topics_.find(remote.topic);
  if (found == local_topics_.end()) return "";
  const Local& local = found->second;
  if (local.type != remote.type) return "type " + remote.type + ", expected " + local.type;
  const auto& ours = remote.writes ? local.requested : local.offered;
  return ours && remote.qos ? mismatch(*remote.qos, remote.writes, *ours) : "";
}

std::vector<DiscoveryMonitor::Participant> DiscoveryMonitor::participants() {
  std::lock_guard lock(mutex_);
  std::vector<Participant> all;
  for (const auto& [key, participant] : participants_) all.push_back(participant);
  return all;
}

std::vector<DiscoveryMonitor::Endpoint> DiscoveryMonitor::endpoints() {
  std::lock_guard lock(mutex_);
  std::vector<Endpoint> all;
  for (const auto& [key, remote] : endpoints_)
    all.push_back({name_of(remote.participant), remote.writes, remote.topic, remote.type});
  return all;
}

std::vector<std::string> DiscoveryMonitor::wrong_types() {
  std::lock_guard lock(mutex_);
  return wrong_types_;
}

std::vector<std::string> DiscoveryMonitor::faults() {
  std::vector<std::string> lines;
  const bool changed = changed_.exchange(false);
  if (!changed && !expecting_ && !unreported_strangers_) return lines;
  std::lock_guard lock(mutex_);
  report_strangers(lines);
  for (auto& [key, remote] : endpoints_) {
    const std::string fault = remote.reported ? "" : fault_of(remote);
    if (fault.empty()) continue;
    remote.reported = true;
    lines.push_back("topic " + remote.topic + ": " + quoted(name_of(remote.participant)) +
                    (remote.writes ? " publishes " : " reads ") + fault);
    if (local_topics_.at(remote.topic).type != remote.type) wrong_types_.push_back(lines.back());
  }
  const Clock::time_point now = Clock::now();
  expecting_ = false;
  for (auto item = expected_.begin(); item != expected_.end();) {
    auto& [address, expected] = *item;
    const auto found =
        std::find_if(participants_.begin(), participants_.end(), [&, &where = address](const auto& each) {
          const std::vector<std::string>& addresses = each.second.addresses;
          return std::find(addresses.begin(), addresses.end(), where) != addresses.end();
        });
    if (found != participants_.end()) {
      if (expected.until == kReported) spdlog::info("peer '{}': answers at {} after all", expected.peer, address);
      item = expected_.erase(item);
      continue;
    }
    if (expected.until != kReported && now >= expected.until) {
      lines.push_back("peer '" + expected.peer + "': no answer at " + address +
                      " (does a service of this domain run there, and does its --interface lead here? citylearn_doctor "
                      "tells more)");
      expected.until = kReported;
    }
    // Those that were reported are looked at again when a participant is found.
    if (expected.until != kReported) expecting_ = true;
    ++item;
  }
  return lines;
}

void DiscoveryMonitor::report_strangers(std::vector<std::string>& lines) {
  const Clock::time_point now = Clock::now();
  unreported_strangers_ = false;
  for (auto& [key, stranger] : strangers_) {
    if (stranger.reported) continue;
    if (now < stranger.until && !stranger.gone) {
      unreported_strangers_ = true;
      continue;
    }
    stranger.reported = true;
    lines.push_back(
        "security: " + stranger.who +
        ": has shown no identity that is trusted here, and is kept out (docs/how-to/secure-a-run.md tells why that "
        "may be)");
  }
}

void DiscoveryMonitor::require_identity() { identity_required_ = true; }

void DiscoveryMonitor::participant_found(const std::string& key, const Participant& participant) {
  std::lock_guard lock(mutex_);
  Participant& found = participants_[key] = participant;
  expecting_ = !expected_.empty();
  found.name = one_line(found.name);  // others choose their names freely, and these go into our log
  const auto known = [&](const auto& endpoint) { return endpoint.second.participant == key; };
  if (identity_required_ && std::none_of(endpoints_.begin(), endpoints_.end(), known))
    add_stranger(key, found, Clock::now() + kIdentityTimeout);
}

void DiscoveryMonitor::identity_refused(const std::string& key, const Participant& participant) {
  std::lock_guard lock(mutex_);
  add_stranger(key, participant, Clock::now());
}

void DiscoveryMonitor::add_stranger(const std::string& key, const Participant& participant, Clock::time_point until) {
  if (strangers_.size() >= kMaxStrangers)
    std::erase_if(strangers_, [](const auto& item) { return item.second.reported; });
  if (strangers_.size() >= kMaxStrangers) return;
  strangers_.try_emplace(key, Stranger{describe(participant), until}).first->second.gone = false;
  unreported_strangers_ = true;
}

void DiscoveryMonitor::participant_lost(const std::string& key) {
  std::lock_guard lock(mutex_);
  participants_.erase(key);
  if (const auto stranger = strangers_.find(key); stranger != strangers_.end()) stranger->second.gone = true;
  std::erase_if(endpoints_, [&](const auto& item) { return item.second.participant == key; });
}

void DiscoveryMonitor::endpoint_found(const std::string& key, const std::string& participant, bool writes,
                                      const std::string& topic, const std::string& type,
                                      const std::optional<EndpointQos>& qos) {
  std::lock_guard lock(mutex_);
  if (endpoints_.try_emplace(key, Remote{participant, writes, one_line(topic), one_line(type), qos}).second)
    changed_ = true;
  if (const auto stranger = strangers_.find(participant); stranger != strangers_.end()) {
    if (stranger->second.reported)
      spdlog::info("security: {}: has shown a trusted identity after all", stranger->second.who);
    strangers_.erase(stranger);
  }
}

void DiscoveryMonitor::endpoint_lost(const std::string& key) {
  std::lock_guard lock(mutex_);
  endpoints_.erase(key);
}

void DiscoveryMonitor::register_local_topic(const Topic& topic, bool writes) {
  std::lock_guard lock(mutex_);
  Local& local = local_topics_.try_emplace(topic.name, Local{topic.type, {}, {}}).first->second;
  if (local.type != topic.type)
    throw Error("type is " + topic.type + ", but this process already uses it with " + local.type,
                "topic " + topic.name);
  std::optional<EndpointQos>& qos = writes ? local.offered : local.requested;
  if (qos) return;
  qos = EndpointQos{.reliable = writes || topic.profile != Profile::kRos2,
                    .durability = internal::is_kept(topic.profile)};
  changed_ = true;
}

void DiscoveryMonitor::expect_peer(const std::string& peer, const std::string& address) {
  std::lock_guard lock(mutex_);
  expected_.try_emplace(address, Expected{peer, Clock::now() + kPeerTimeout});
  expecting_ = true;
}

}  // namespace citylearn
