#include "core/surroundings.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/error.h"

namespace citylearn {
namespace {

constexpr auto kTold = std::chrono::steady_clock::time_point::max();  // the end of waiting for a peer, once it was told

}  // namespace

std::string Surroundings::name_of(const std::string& participant) const {
  const auto found = participants_.find(participant);
  return found == participants_.end() ? "" : found->second.name;
}

bool Surroundings::differs(const Remote& remote) const {
  const auto expected = own_.find(remote.topic);
  return expected != own_.end() && expected->second != remote.type;
}

std::vector<Surroundings::Participant> Surroundings::participants() {
  std::lock_guard lock(mutex_);
  std::vector<Participant> all;
  for (const auto& [key, participant] : participants_) all.push_back(participant);
  return all;
}

std::vector<Surroundings::Endpoint> Surroundings::endpoints() {
  std::lock_guard lock(mutex_);
  std::vector<Endpoint> all;
  for (const auto& [key, remote] : endpoints_)
    all.push_back({name_of(remote.participant), remote.writes, remote.topic, remote.type, differs(remote)});
  return all;
}

std::vector<std::string> Surroundings::faults() {
  std::vector<std::string> lines;
  const bool changed = changed_.exchange(false);
  if (!changed && !expecting_) return lines;
  std::lock_guard lock(mutex_);
  for (auto& [key, remote] : endpoints_) {
    if (remote.reported || !differs(remote)) continue;
    remote.reported = true;
    const std::string name = name_of(remote.participant);
    const std::string who = name.empty() ? "an unnamed participant" : "'" + name + "'";
    lines.push_back("topic " + remote.topic + ": " + who + (remote.writes ? " publishes" : " reads") + " type " +
                    remote.type + ", expected " + own_.at(remote.topic));
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
      if (expected.until == kTold) spdlog::info("peer '{}': answers at {} after all", expected.peer, address);
      item = expected_.erase(item);
      continue;
    }
    if (expected.until != kTold && now >= expected.until) {
      lines.push_back("peer '" + expected.peer + "': nobody answers at " + address +
                      " (does a service of this domain run there, and does its --interface lead here? citylearn_doctor "
                      "tells more)");
      expected.until = kTold;
    }
    // Those that were told are looked at again when a participant is found.
    if (expected.until != kTold) expecting_ = true;
    ++item;
  }
  return lines;
}

void Surroundings::participant_found(const std::string& key, const Participant& participant) {
  std::lock_guard lock(mutex_);
  participants_[key] = participant;
  expecting_ = !expected_.empty();
}

void Surroundings::participant_lost(const std::string& key) {
  std::lock_guard lock(mutex_);
  participants_.erase(key);
  std::erase_if(endpoints_, [&](const auto& item) { return item.second.participant == key; });
}

void Surroundings::endpoint_found(const std::string& key, const std::string& participant, bool writes,
                                  const std::string& topic, const std::string& type) {
  std::lock_guard lock(mutex_);
  if (endpoints_.try_emplace(key, Remote{participant, writes, topic, type}).second) changed_ = true;
}

void Surroundings::endpoint_lost(const std::string& key) {
  std::lock_guard lock(mutex_);
  endpoints_.erase(key);
}

void Surroundings::own(const std::string& topic, const std::string& type) {
  std::lock_guard lock(mutex_);
  const auto [known, added] = own_.try_emplace(topic, type);
  if (!added && known->second != type)
    throw Error("type is " + type + ", but this process already uses it with " + known->second, "topic " + topic);
  if (added) changed_ = true;
}

void Surroundings::expect(const std::string& peer, const std::string& address) {
  std::lock_guard lock(mutex_);
  expected_.try_emplace(address, Expected{peer, Clock::now() + kPatience});
  expecting_ = true;
}

}  // namespace citylearn
