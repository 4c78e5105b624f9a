// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/shared_updates.h"

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

/// The message of a rank to all others about its update.
struct UpdateNews {
  std::uint64_t steps = 0, generation = 0;
  double elapsed = 0;
  std::vector<std::array<double, 3>> episodes;  // reward, SPL and steps
  std::map<std::string, std::uint64_t> counters;
  std::map<std::string, std::ptrdiff_t> tensors;  // sizes
};

std::string news_of(const LocalUpdate& mine, const LearnerState& state) {
  nlohmann::json episodes = nlohmann::json::array(), tensors = nlohmann::json::object();
  for (const FinishedEpisode& episode : mine.episodes) episodes.push_back({episode.reward, episode.spl, episode.steps});
  for (const auto& [name, tensor] : state.tensors)
    if (is_shared(name)) tensors[name] = tensor.size();
  return nlohmann::json{{"steps", mine.steps},  {"generation", mine.generation}, {"elapsed", mine.elapsed},
                        {"episodes", episodes}, {"counters", state.counters},    {"tensors", tensors}}
      .dump();
}

UpdateNews read_news(const RankMeeting::Member& member) {
  const std::string where = "update of rank " + std::to_string(member.rank);
  try {
    const nlohmann::json news = parse_json(member.news, where);
    UpdateNews read;
    news.at("steps").get_to(read.steps);
    news.at("generation").get_to(read.generation);
    news.at("elapsed").get_to(read.elapsed);
    news.at("episodes").get_to(read.episodes);
    news.at("counters").get_to(read.counters);
    news.at("tensors").get_to(read.tensors);
    return read;
  } catch (const nlohmann::json::exception& problem) {
    throw Error(problem.what(), where);
  }
}

/// Returns the shared tensors behind one another, times `weight`. Without weight none of their numbers counts, even if
/// it is not finite.
std::vector<float> weighted(const LearnerState& state, float weight) {
  std::vector<float> values;
  for (const auto& [name, tensor] : state.tensors)
    if (is_shared(name))
      for (const float value : tensor) values.push_back(weight > 0 ? weight * value : 0);
  return values;
}

void put_back(const std::vector<float>& values, LearnerState& state) {
  auto next = values.begin();
  for (auto& [name, tensor] : state.tensors)
    if (is_shared(name)) {
      std::copy_n(next, tensor.size(), tensor.begin());
      next += tensor.size();
    }
}

}  // namespace

/// Learns from the gradients of all. One that is behind learns nothing, and adds nothing until the others have made all
/// their steps; returns their number.
std::uint64_t SharedUpdates::learn_together(const RankMeeting& meeting, const Learn& learn, LearnerState& state) {
  struct Sum : GradientSharing {
    explicit Sum(RankGroup* all) : group(all) {}
    void sum(std::span<float> values) override {
      if (group) group->sum(values);
    }
    RankGroup* group;
  } gradients(meeting.members.size() > 1 ? &group_ : nullptr);
  if (!meeting.behind(meeting.mine)) {
    learn(&gradients, state);
    return 0;
  }
  std::vector<float> nothing(static_cast<std::size_t>(state.tensors.at("parameters").size()) + 1);
  for (std::uint64_t steps = 0;; ++steps) {
    std::fill(nothing.begin(), nothing.end(), 0.0f);
    gradients.sum(nothing);
    if (nothing.back() == 0) return steps;
  }
}

SharedUpdate SharedUpdates::share(const LocalUpdate& mine, const Learn& learn, LearnerState& state) {
  if (!each_step_) learn(nullptr, state);
  const std::string text = news_of(mine, state);
  while (true) {
    const RankMeeting meeting = group_.meet({mine.updates, text, mine.progress});
    const std::size_t count = meeting.members.size();
    std::vector<UpdateNews> news;
    for (const RankMeeting::Member& member : meeting.members) news.push_back(read_news(member));
    for (std::size_t i = 0; i < count; ++i)
      if (news[i].tensors != news[meeting.mine].tensors)
        throw Error("its learner has other tensors", "rank " + std::to_string(meeting.members[i].rank));

    SharedUpdate shared;
    for (std::size_t i = 0; i < count; ++i) {
      shared.generation = std::max(shared.generation, news[i].generation);
      if (meeting.behind(i)) {
        shared.joined = true;
        continue;
      }
      shared.steps += news[i].steps;
      shared.elapsed = std::max(shared.elapsed, news[i].elapsed);
      for (const auto& [reward, spl, steps] : news[i].episodes)
        shared.episodes.push_back({0, 0, reward, spl, static_cast<int>(steps)});
    }
    // Where gradients were shared, and before the first update, all follow the leader.
    const bool weigh = !each_step_ && shared.steps > 0, behind = meeting.behind(meeting.mine);
    const double own =
        weigh ? (behind ? 0 : static_cast<double>(mine.steps)) : (meeting.mine == meeting.leader ? 1 : 0);
    const double all = weigh ? static_cast<double>(shared.steps) : 1;
    std::vector<float> values;
    std::uint64_t followed = 0;
    bool succeeded = true;
    try {
      if (each_step_ && shared.steps > 0) followed = learn_together(meeting, learn, state);
      values = weighted(state, static_cast<float>(own / all));
      if (count > 1) group_.sum(values);
    } catch (const RankLost&) {
      succeeded = false;
    }
    if (!group_.agree(succeeded)) continue;

    put_back(values, state);
    // The leader's counters are those after its own update, or, where gradients were shared, before it.
    const std::map<std::string, std::uint64_t>& leader = news[meeting.leader].counters;
    const bool learned = each_step_ && shared.steps > 0;
    const auto set = [&](const char* name, std::uint64_t more) {
      if (const auto counter = leader.find(name); counter != leader.end())
        state.counters[name] = counter->second + more;
    };
    set("steps", shared.steps - (each_step_ ? 0 : news[meeting.leader].steps));
    set("updates", learned ? 1 : 0);
    if (!learned || behind) set("adam_steps", followed);
    if (behind) shared.progress = meeting.progress;
    lowest_ = meeting.mine == 0;
    members_ = static_cast<int>(count);
    return shared;
  }
}

}  // namespace citylearn
