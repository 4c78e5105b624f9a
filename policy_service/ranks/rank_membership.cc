// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/rank_membership.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "core/exchange/timing.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/random.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

template <class Number>
bool contains_number(const std::vector<Number>& all, Number one) {
  return std::find(all.begin(), all.end(), one) != all.end();
}

/// Returns " is A, that of the others B" behind the names that lead to the first difference.
std::string difference(const nlohmann::json& ours, const nlohmann::json& theirs) {
  if (!ours.is_object() || !theirs.is_object())
    return ours == theirs ? "" : " is " + ours.dump() + ", that of the others " + theirs.dump();
  std::set<std::string> names;
  for (const auto* side : {&ours, &theirs})
    for (const auto& [name, value] : side->items()) names.insert(name);
  for (const std::string& name : names) {
    const std::string inner = difference(ours.value(name, nlohmann::json()), theirs.value(name, nlohmann::json()));
    if (!inner.empty()) return name + (inner.front() == ' ' ? "" : ".") + inner;
  }
  return "";
}

}  // namespace

std::string identity_difference(const std::string& ours, const std::string& theirs) {
  try {
    return difference(parse_json(ours, "identity"), parse_json(theirs, "identity"));
  } catch (const Error&) {
    return "";  // not of a rank
  }
}

RankMembership::RankMembership(const Options& options, std::uint64_t incarnation, Clock::time_point now)
    : options_(options), incarnation_(incarnation), last_tick_(now) {
  if (options.identity.size() > msg::MAX_RANK_OPTIONS) throw Error("their options are too long", "ranks");
  status_.header().incarnation(incarnation);
  status_.rank(static_cast<std::uint32_t>(options.rank));
  status_.ranks(static_cast<std::uint32_t>(options.ranks));
  status_.host(options.host);
  Sha256 identity;
  identity.add(options.identity);
  status_.identity(identity.first_8_bytes());
}

void RankMembership::take(const Status& status, Clock::time_point now) {
  pass_to(now);
  if (status.ranks() > msg::MAX_RANKS || status.rank() >= status.ranks() || is_twin(status, now) || !fits(status, now))
    return;
  Peer& peer = peers_[status.rank()];
  const Incumbent::Heard heard = peer.incumbent.hear(status.header().incarnation(), now);
  if (heard == Incumbent::Heard::kOther) return;
  if (heard == Incumbent::Heard::kSuccessor) peer.order = {};
  if (!peer.order.in_order(status.header(), now)) return;
  if (status.leaves() && !peer.status.leaves()) spdlog::info("rank {} has finished", status.rank());
  peer.status = status;
  peer.came = now;
  if (status.leaves()) peer.incumbent.leave();
  look(now);
}

/// Returns whether a status is of this rank. Of two processes with one rank that stays which more ranks hear.
bool RankMembership::is_twin(const Status& status, Clock::time_point now) {
  if (status.rank() != status_.rank()) return false;
  const std::uint64_t other = status.header().incarnation();
  if (std::exchange(twin_, other) != other) twin_since_ = now;
  const auto weight = [&](std::uint64_t incarnation, const Status& own) {
    const auto hear = [&](const auto& entry) {
      return now - entry.second.came <= kRankSilence && contains_number(entry.second.status.hears(), incarnation);
    };
    return std::tuple(std::count_if(peers_.begin(), peers_.end(), hear), own.history() != 0, ~incarnation);
  };
  // The first status may be the last one of a process that was killed.
  if (!status.leaves() && now - twin_since_ > 2 * kRankHeartbeat &&
      weight(other, status) > weight(incarnation_, status_))
    refusal_ = "a living process, on " + std::string(status.host().c_str()) + ", has this rank";
  return true;
}

/// Returns whether a rank can work with this one. Of two that cannot, the one is refused that has shared no updates, or
/// else the later one.
bool RankMembership::fits(const Status& status, Clock::time_point now) {
  const bool same_number = status.ranks() == status_.ranks();
  if (same_number && status.identity() == status_.identity()) return true;
  other_heard_ = now;
  if (status.leaves() || status_.history() != 0 ||
      (status.history() == 0 && status.header().incarnation() > incarnation_))
    return false;
  if (!same_number)
    refusal_ =
        "--ranks is " + std::to_string(status_.ranks()) + ", that of the others " + std::to_string(status.ranks());
  else
    refusal_ = identity_difference(options_.identity, {status.options().begin(), status.options().end()});
  return false;
}

void RankMembership::tick(Clock::time_point now) {
  pass_to(now);
  look(now);
}

/// What came while this process stood still is not read yet: nobody is silent for that.
void RankMembership::pass_to(Clock::time_point now) {
  const auto pause = now - std::exchange(last_tick_, now);
  if (pause <= kRankPaused) return;
  resumed_ = now;
  for (auto& [rank, peer] : peers_) peer.came += pause;
}

/// Finds out who is here, and does what follows from it.
void RankMembership::look(Clock::time_point now) {
  const auto before = std::exchange(here_, {{incarnation_, &status_}});
  std::vector<std::uint64_t> hears;
  for (const auto& [rank, peer] : peers_) {
    if (peer.status.leaves() || now - peer.came > kRankSilence) continue;
    hears.push_back(peer.incumbent.incarnation());
    if (contains_number(peer.status.hears(), incarnation_)) here_[hears.back()] = &peer.status;
  }
  for (const auto& [incarnation, status] : before)
    if (!here_.contains(incarnation) && !status->leaves() && status->header().incarnation() == incarnation)
      spdlog::info("rank {} is silent: the others go on without it", status->rank());
  status_.hears(std::move(hears));
  const bool other = other_heard_ != Clock::time_point{} && now - other_heard_ <= kRankSilence;
  status_.options().assign(options_.identity.begin(), other ? options_.identity.end() : options_.identity.begin());
  find_coordinator(now);
  if (coordinates())
    coordinate(now);
  else if (const auto found = here_.find(status_.coordinator()); found != here_.end())
    obey(*found->second);
}

std::vector<const msg::RankStatus*> RankMembership::followers(std::uint64_t coordinator) const {
  std::vector<const Status*> all;
  for (const auto& [incarnation, status] : here_)
    if (status->coordinator() == coordinator) all.push_back(status);
  std::sort(all.begin(), all.end(), [](const Status* a, const Status* b) { return a->rank() < b->rank(); });
  return all;
}

std::tuple<bool, std::size_t, std::uint64_t> RankMembership::weight(std::uint64_t coordinator) const {
  const auto all = followers(coordinator);
  const bool learned = std::any_of(all.begin(), all.end(), [](const Status* one) { return one->history() != 0; });
  return {learned, all.size(), ~coordinator};
}

/// Follows the best coordinator that is here. Where there is none, the lowest rank of those that lost theirs takes
/// over.
void RankMembership::find_coordinator(Clock::time_point now) {
  const std::uint64_t before = status_.coordinator();
  const auto is_here = [&](std::uint64_t one) { return here_.contains(one) && here_.at(one)->coordinator() == one; };
  if (before != 0 && !coordinates() && is_here(before)) return;
  if (!coordinates()) status_.coordinator(0);
  // One that has shared updates leaves no vote behind: it goes to others that have, or continues with those that are
  // left.
  const bool learned = status_.history() != 0;
  std::uint64_t best = coordinates() ? incarnation_ : 0;
  for (const auto& [incarnation, status] : here_) {
    if (status->coordinator() != incarnation || (learned && !std::get<0>(weight(incarnation)))) continue;
    if (best == 0 || weight(incarnation) > weight(best)) best = incarnation;
  }
  if (best != 0) {
    if (best != incarnation_) status_.call(0);
    if (best != before) spdlog::info("rank {} coordinates the ranks", here_.at(best)->rank());
    return status_.coordinator(best);
  }
  for (const auto& [incarnation, status] : here_) {
    if (incarnation == incarnation_ || (learned && status->history() == 0)) continue;
    if (status->coordinator() != 0 || status->rank() < status_.rank() || (!learned && status->history() != 0)) return;
  }
  if (learned) spdlog::warn("the ranks' coordinator is lost: rank {} coordinates them", options_.rank);
  status_.coordinator(incarnation_);
  settled_ = now + kRankSettle;
}

void RankMembership::coordinate(Clock::time_point now) {
  if (now < settled_ &&
      std::any_of(here_.begin(), here_.end(), [](const auto& entry) { return entry.second->coordinator() == 0; }))
    return;  // they lost a coordinator too, and are coming
  // After it stood still it reads old votes first, of ranks that have gone on without it.
  if (now - resumed_ < 2 * kRankRepeat) return;
  for (const Status* one : followers(incarnation_)) {
    if (one->phase() == msg::ADDING) return;
    const bool called = status_.call() != 0 && contains_number(status_.members(), one->header().incarnation());
    if (called && one->taken() != status_.call() && now - called_at_ <= kRankSilence)
      return;  // it has not heard it yet
  }
  decide();
  make_call(now);
}

/// Decides the newest call on which a follower waits for a verdict: where one knows, that holds, else it counts if all
/// that voted have its sum.
void RankMembership::decide() {
  const auto all = followers(incarnation_);
  const Status* newest = nullptr;
  for (const Status* one : all)
    if (one->phase() == msg::VOTED && (!newest || one->number() > newest->number())) newest = one;
  if (!newest) return;
  const std::uint64_t id = newest->taken();
  if (id != status_.verdict()) {
    bool voted = true;
    std::optional<bool> known;
    for (const Status* one : all) {
      if (one->taken() != id) continue;
      if (one->phase() == msg::VOTED)
        voted &= one->yes();
      else
        known = one->yes();
    }
    status_.verdict(id);
    status_.counts(known.value_or(voted));
  }
  if (status_.call() == id) status_.call(0);
  obey(status_);
}

/// Calls all followers once all of them wait: they have heard how the last call ended.
void RankMembership::make_call(Clock::time_point now) {
  const auto all = followers(incarnation_);
  std::map<std::uint64_t, std::tuple<bool, int, std::uint64_t>> histories;  // learned, members, updates
  std::uint64_t number = 0;
  std::set<std::uint64_t> connected;
  for (const Status* one : all) {
    if (one->phase() != msg::ARRIVED) return;
    auto& [learned, count, updates] = histories[one->history()];
    learned = one->history() != 0;
    ++count;
    updates = std::max(updates, one->updates());
    number = std::max(number, one->number());
    connected.insert(one->connected());
  }
  const auto first = std::max_element(histories.begin(), histories.end(),
                                      [](const auto& a, const auto& b) { return a.second < b.second; });
  if (first->first == 0 && all.size() < status_.ranks()) return;  // the first time all are needed
  status_.call_number(number + 1);
  status_.call(mix_seeds({incarnation_, number + 1}));
  status_.call_history(first->first);
  status_.call_connected(connected.size() == 1 ? *connected.begin() : 0);
  status_.members().clear();
  status_.member_rank().clear();
  status_.member_updates().clear();
  status_.newcomer().clear();
  for (const Status* one : all) {
    status_.members().push_back(one->header().incarnation());
    status_.member_rank().push_back(one->rank());
    status_.member_updates().push_back(one->updates());
    status_.newcomer().push_back(one->history() != first->first);
  }
  called_at_ = now;
  obey(status_);
}

/// Takes what the coordinator decides.
void RankMembership::obey(const Status& coordinator) {
  if (status_.phase() == msg::VOTED && coordinator.verdict() == status_.taken()) {
    decision_ = coordinator.counts() && status_.yes();
    // Without the sum of an update that counts, this rank comes like a new one.
    if (coordinator.counts() && !status_.yes()) status_.taken(0);
    if (*decision_) status_.history(next_history_);
    status_.yes(*decision_);
    status_.phase(msg::LEARNING);
  }
  if (status_.phase() != msg::ARRIVED || coordinator.call() == 0 || coordinator.call_number() <= status_.number() ||
      !contains_number(coordinator.members(), incarnation_))
    return;
  RankCall call{coordinator.call(), coordinator.call_connected(), {}};
  for (std::size_t i = 0; i < coordinator.members().size(); ++i) {
    const auto found = here_.find(coordinator.members()[i]);
    const std::uint32_t rank = coordinator.member_rank()[i];
    // Only what this rank hears itself counts, in the order of ranks.
    if (found == here_.end() || found->second->rank() != rank || (i > 0 && rank <= coordinator.member_rank()[i - 1]))
      return;
    call.members.push_back(
        {found->first, static_cast<int>(rank), coordinator.member_updates()[i], coordinator.newcomer()[i] != 0});
  }
  call_ = std::move(call);
  next_history_ = mix_seeds({coordinator.call_history(), coordinator.call()});
  status_.taken(coordinator.call());
  status_.number(coordinator.call_number());
  status_.connection().clear();
  status_.yes(false);
  status_.phase(msg::ADDING);
}

void RankMembership::arrive(std::uint64_t updates, std::uint64_t connected) {
  call_.reset();
  decision_.reset();
  status_.updates(updates);
  status_.connected(connected);
  status_.phase(msg::ARRIVED);
}

void RankMembership::vote(bool yes) {
  status_.yes(yes);
  status_.phase(msg::VOTED);
}

const std::vector<std::uint8_t>* RankMembership::connection_of(std::uint64_t incarnation) const {
  const auto found = here_.find(incarnation);
  if (found == here_.end() || found->second->taken() != status_.taken() || found->second->connection().empty())
    return nullptr;
  return &found->second->connection();
}

bool RankMembership::all_here() const {
  return call_ && std::all_of(call_->members.begin(), call_->members.end(),
                              [&](const RankCall::Member& one) { return here_.contains(one.incarnation); });
}

std::vector<int> RankMembership::missing() const {
  std::set<std::uint32_t> here;
  for (const auto& [incarnation, status] : here_) here.insert(status->rank());
  std::vector<int> missing;
  for (int rank = 0; rank < options_.ranks; ++rank)
    if (!here.contains(static_cast<std::uint32_t>(rank))) missing.push_back(rank);
  return missing;
}

}  // namespace citylearn
