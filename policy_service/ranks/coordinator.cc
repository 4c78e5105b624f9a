// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/coordinator.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/version.h"

namespace citylearn {
namespace {

/// Time for ranks to come over from a coordinator that was lost, or for another group to take over the rest.

std::vector<char> packed(const nlohmann::json& message) {
  const std::string text = message.dump();
  return {text.begin(), text.end()};
}

nlohmann::json unpacked(const std::vector<char>& message) {
  return parse_json({message.data(), message.size()}, "message of a rank");
}

}  // namespace

std::string identity_difference(const nlohmann::json& theirs, const nlohmann::json& ours) {
  if (theirs.is_object() && ours.is_object()) {
    std::set<std::string> names;
    for (const auto* side : {&theirs, &ours})
      for (const auto& [name, value] : side->items()) names.insert(name);
    for (const std::string& name : names) {
      const auto there = theirs.find(name), here = ours.find(name);
      const std::string difference = identity_difference(there == theirs.end() ? nlohmann::json() : *there,
                                                         here == ours.end() ? nlohmann::json() : *here);
      if (difference.empty()) continue;
      return difference.front() == ' ' ? name + difference : name + "." + difference;
    }
    return "";
  }
  return theirs == ours ? "" : " is " + theirs.dump() + ", that of the others " + ours.dump();
}

Coordinator::Coordinator(std::string incarnation, Send send)
    : incarnation_(std::move(incarnation)), send_(std::move(send)) {}

Coordinator::~Coordinator() = default;

/// Returns why a rank cannot be a member; empty when it can.
std::string Coordinator::refusal(const Json& hello) const {
  if (const int theirs = hello.value("protocol", 0); theirs != kRankProtocol)
    return "its version " + hello.value("version", "?") + " has protocol " + std::to_string(theirs) +
           " between ranks, that of the others " + version() + " protocol " + std::to_string(kRankProtocol);
  if (members_.empty()) return "";
  if (const int theirs = hello.at("ranks").get<int>(); theirs != ranks_)
    return "--ranks is " + std::to_string(theirs) + ", that of the others " + std::to_string(ranks_);
  const std::string difference = identity_difference(hello.at("identity"), parse_json(identity_, "identity"));
  return difference.empty() || difference.front() != ' ' ? difference : "identity" + difference;
}

void Coordinator::introduce(int connection, const Json& hello, Clock::time_point now) {
  if (const std::string why = refusal(hello); !why.empty()) {
    const Json message = {{"type", "refused"}, {"why", why}};
    send_(connection, &message);
    send_(connection, nullptr);
    return;
  }
  const int rank = hello.at("rank").get<int>();
  const std::string incarnation = hello.at("incarnation").get<std::string>();
  for (const auto& [other, member] : members_) {
    if (member.rank != rank) continue;
    if (member.incarnation != incarnation) {
      contested_[connection] = packed(hello);  // until the other one is heard, or lost
      return;
    }
    const int old = other;
    remove(old, "");
    send_(old, nullptr);
    break;
  }
  welcome(connection, hello, now);
}

void Coordinator::welcome(int connection, const Json& hello, Clock::time_point now) {
  const bool takes_over = hello.value("takeover", false);
  Member member;
  member.rank = hello.at("rank").get<int>();
  member.incarnation = hello.at("incarnation").get<std::string>();
  member.address = hello.at("address").get<std::string>();
  member.heard = now;
  if (members_.empty()) {
    identity_ = hello.at("identity").dump();
    ranks_ = hello.at("ranks").get<int>();
    met_ = 0;
    expected_.clear();
    if (takes_over) {
      settled_ = now + kRankSettle;
      for (const Json& one : hello.at("expected")) expected_.insert(one.get<std::string>());
      spdlog::info("rank {} coordinates the ranks from now on", member.rank);
    }
  }
  const bool kept = takes_over && now < settled_ && expected_.contains(member.incarnation);
  if (kept) member.committed = hello.at("committed").get<std::uint64_t>();
  const Json message = {{"type", "welcome"}, {"coordinator", incarnation_}, {"kept", kept}};
  send_(connection, &message);
  members_[connection] = std::move(member);
  send_members();
}

void Coordinator::send_members() {
  Json list = Json::array();
  for (const auto& [connection, member] : members_)
    list.push_back({{"rank", member.rank}, {"incarnation", member.incarnation}, {"address", member.address}});
  const Json message = {{"type", "members"}, {"members", list}};
  for (const auto& [connection, member] : members_) send_(connection, &message);
}

void Coordinator::receive(int connection, const Json& message, Clock::time_point now) {
  const auto found = members_.find(connection);
  if (found == members_.end()) return;
  Member& member = found->second;
  member.heard = now;
  for (const auto& [waiting, hello] : std::map<int, std::vector<char>>(contested_)) {
    if (unpacked(hello).at("rank").get<int>() != member.rank) continue;
    contested_.erase(waiting);
    const Json refused = {{"type", "refused"}, {"why", "a living process, at " + member.address + ", has this rank"}};
    send_(waiting, &refused);
    send_(waiting, nullptr);
  }
  const std::string type = message.at("type").get<std::string>();
  if (type == "arrive") {
    member.vote.reset();
    member.committed = message.at("committed").get<std::uint64_t>();
    member.seen = message.at("seen").get<std::uint64_t>();
    member.arrival = packed(message);
  } else if (type == "vote") {
    member.arrival.clear();
    member.vote = message.at("meeting").get<std::uint64_t>();
    member.yes = message.at("yes").get<bool>();
  } else if (type == "store") {
    for (const auto& [other, one] : members_) send_(other, &message);
  } else if (type == "leave") {
    remove(connection, "has finished");
    send_(connection, nullptr);
    send_members();
  }
  decide(now);
}

void Coordinator::remove(int connection, const std::string& why) {
  const auto found = members_.find(connection);
  if (found == members_.end()) return;
  if (!why.empty()) spdlog::info("rank {} {}", found->second.rank, why);
  members_.erase(found);
}

void Coordinator::lose(int connection, Clock::time_point now) {
  contested_.erase(connection);
  if (!members_.contains(connection)) return;
  remove(connection, "is lost: the others go on without it");
  // Perhaps not it was lost but this process, and the others have another coordinator, which will ask for it.
  if (2 * members_.size() <= met_) settled_ = std::max(settled_, now + kRankSettle);
  send_members();
  decide(now);
}

void Coordinator::tick(Clock::time_point now) {
  std::vector<int> silent;
  for (const auto& [connection, member] : members_)
    if (now - member.heard > kRankSilence) silent.push_back(connection);
  for (const int connection : silent) {
    remove(connection, "is silent: the others go on without it");
    send_(connection, nullptr);
  }
  if (!silent.empty()) send_members();
  for (const auto& [connection, hello] : std::map<int, std::vector<char>>(contested_)) {
    const Json message = unpacked(hello);
    if (std::any_of(members_.begin(), members_.end(),
                    [&](const auto& entry) { return entry.second.rank == message.at("rank").get<int>(); }))
      continue;
    contested_.erase(connection);
    introduce(connection, message, now);
  }
  decide(now);
}

void Coordinator::beat() {
  const Json message = {{"type", "alive"}};
  for (const auto& [connection, member] : members_) send_(connection, &message);
}

void Coordinator::reset_silence_timers(Clock::time_point now) {
  for (auto& [connection, member] : members_) member.heard = now;
}

void Coordinator::hand_over(const std::string& address) {
  const Json message = {{"type", "redirect"}, {"address", address}};
  for (const auto& [connection, member] : std::exchange(members_, {})) send_(connection, &message);
}

std::uint64_t Coordinator::established() const {
  std::uint64_t last = 0;
  for (const auto& [connection, member] : members_) last = std::max(last, member.committed);
  return last;
}

bool Coordinator::yields_to(const Json& probe) const {
  const auto order = [](const Json& one) {
    return std::tuple(one.at("established").get<bool>(), one.at("members").get<std::size_t>(),
                      one.at("address").get<std::string>());
  };
  return order(probe) > order(this->probe(""));
}

Coordinator::Json Coordinator::probe(const std::string& address) const {
  return {{"type", "probe"}, {"established", established() > 0}, {"members", members_.size()}, {"address", address}};
}

/// Decides what the members wait for, once all of them wait.
void Coordinator::decide(Clock::time_point now) {
  if (members_.empty()) return;
  if (now < settled_) {
    std::set<std::string> missing = expected_;
    for (const auto& [connection, member] : members_) missing.erase(member.incarnation);
    if (expected_.empty() || !missing.empty()) return;
    settled_ = now;
  }
  bool voting = false;
  for (const auto& [connection, member] : members_) {
    if (!member.vote && member.arrival.empty()) return;
    voting |= member.vote.has_value();
  }
  if (voting)
    vote();
  else
    meet();
}

/// An update counts when all living members had its sum. Where one knows already whether it did, that holds.
void Coordinator::vote() {
  std::uint64_t meeting = 0;
  for (const auto& [connection, member] : members_) meeting = std::max(meeting, member.vote.value_or(0));
  bool yes = true;
  for (const auto& [connection, member] : members_)
    if (member.vote == meeting) yes &= member.yes;
  for (const auto& [connection, member] : members_)
    if (!member.vote && member.seen == meeting) yes = member.committed == meeting;
  for (auto& [connection, member] : members_) {
    if (!member.vote) continue;
    const Json message = {{"type", "decision"}, {"meeting", *member.vote}, {"yes", yes && member.vote == meeting}};
    member.vote.reset();
    if (message.at("yes").get<bool>()) member.committed = meeting;
    send_(connection, &message);
  }
}

void Coordinator::meet() {
  if (established() == 0 && static_cast<int>(members_.size()) < ranks_) return;  // the first time all are needed
  Json attendees = Json::array();
  std::uint64_t last = 0;
  std::vector<std::pair<int, int>> order;
  for (const auto& [connection, member] : members_) {
    order.emplace_back(member.rank, connection);
    last = std::max(last, member.seen);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [rank, connection] : order) {
    const Member& member = members_.at(connection);
    Json attendee = unpacked(member.arrival);
    attendee["rank"] = rank;
    attendee["incarnation"] = member.incarnation;
    attendee["newcomer"] = member.committed < established();
    attendees.push_back(std::move(attendee));
  }
  met_ = members_.size();
  const Json message = {{"type", "meeting"}, {"meeting", last + 1}, {"attendees", attendees}};
  for (auto& [connection, member] : members_) {
    member.arrival.clear();
    send_(connection, &message);
  }
}

}  // namespace citylearn
