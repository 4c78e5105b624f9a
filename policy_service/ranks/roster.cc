// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/roster.h"

#include <nlohmann/json.hpp>

#include "core/util/error.h"
#include "policy_service/ranks/roster_thread.h"

namespace citylearn {

Roster::Roster(const RosterOptions& options) : thread_(std::make_unique<Thread>(options)) {}

Roster::~Roster() = default;

const std::string& Roster::host() const { return thread_->host(); }

RosterMeeting Roster::arrive(const RankArrival& arrival, std::uint64_t tag, const std::function<void()>& idle) {
  Thread& thread = *thread_;
  const std::lock_guard all(thread.user);
  const nlohmann::json message = thread.ask({{"type", "arrive"},
                                             {"updates", arrival.updates},
                                             {"news", arrival.news},
                                             {"progress", arrival.progress},
                                             {"tag", tag}},
                                            "meeting", idle);
  RosterMeeting result;
  result.number = message.at("meeting").get<std::uint64_t>();
  RankMeeting& meeting = result.meeting;
  const auto& attendees = message.at("attendees");
  for (const auto& attendee : attendees) {
    const std::string incarnation = attendee.at("incarnation").get<std::string>();
    if (incarnation == thread.incarnation()) meeting.mine = meeting.members.size();
    meeting.members.push_back({attendee.at("rank").get<int>(), attendee.at("updates").get<std::uint64_t>(),
                               attendee.at("newcomer").get<bool>(), attendee.at("news").get<std::string>()});
    result.incarnations.push_back(incarnation);
    result.tags.push_back(attendee.at("tag").get<std::uint64_t>());
  }
  meeting.leader = RankMeeting::leader_of(meeting.members);
  meeting.progress = attendees.at(meeting.leader).at("progress").get<std::string>();
  return result;
}

void Roster::set(std::uint64_t meeting, const std::string& key, const std::vector<char>& value) {
  std::vector<int> bytes;
  for (const char byte : value) bytes.push_back(static_cast<unsigned char>(byte));
  thread_->tell({{"type", "store"}, {"meeting", meeting}, {"key", key}, {"value", bytes}});
}

bool Roster::get(std::uint64_t meeting, const std::string& key, Clock::time_point deadline, std::vector<char>& value) {
  return thread_->stored(meeting, key, deadline, value);
}

bool Roster::vote(bool yes, const std::function<void()>& idle) {
  const std::lock_guard all(thread_->user);
  return thread_->ask({{"type", "vote"}, {"yes", yes}}, "decision", idle).at("yes").get<bool>();
}

void Roster::leave() { thread_->leave(); }

}  // namespace citylearn
