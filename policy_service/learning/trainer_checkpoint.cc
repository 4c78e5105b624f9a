// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "policy_service/learning/trainer_state.h"

namespace citylearn {

nlohmann::json Trainer::Impl::identity() const {
  nlohmann::json identity = {{"agent", options.agent},
                             {"learner", options.learner},
                             {"network", parameters.network.values()},
                             {"learner_parameters", parameters.learner.values()},
                             {"trainer", parameters.trainer.values()},
                             {"seed", options.seed},
                             {"curriculum", options.curriculum},
                             {"task",
                              {{"features", task.features},
                               {"frames", task.frames},
                               {"first_frame", options.first_frame},
                               {"max_steps", options.max_steps}}}};
  if (task.streets) identity["task"]["places"] = task.places();
  if (options.max_detour > 0) identity["task"]["max_detour"] = options.max_detour;
  if (!frozen.empty()) identity["frozen"] = frozen;
  return identity;
}

nlohmann::json Trainer::Impl::progress_json() const {
  const auto optional = [](const std::optional<std::uint64_t>& value) {
    return value ? nlohmann::json(*value) : nlohmann::json();
  };
  return {{"updates", progress.updates},
          {"steps", progress.steps},
          {"episodes", progress.episodes},
          {"lesson", progress.lesson},
          {"lesson_episodes", lesson_episodes},
          {"smoothed_reward", progress.smoothed_reward},
          {"reward", progress.reward},
          {"spl", progress.spl},
          {"episodes_to_spl95", optional(progress.episodes_to_spl95)},
          {"steps_to_spl95", optional(progress.steps_to_spl95)},
          {"recent", recent},
          {"recent_next", recent_next},
          {"recent_steps", recent_steps},
          {"cut", generation}};
}

SavedProgress Trainer::Impl::read_progress(const nlohmann::json& saved) const {
  SavedProgress read;
  const auto number = [&](const char* name) {
    return saved.at(name).is_null() ? std::numeric_limits<double>::quiet_NaN() : saved.at(name).get<double>();
  };
  const auto optional = [&](const char* name) -> std::optional<std::uint64_t> {
    if (saved.at(name).is_null()) return std::nullopt;
    return saved.at(name).get<std::uint64_t>();
  };
  read.progress.updates = saved.at("updates").get<std::uint64_t>();
  read.progress.steps = saved.at("steps").get<std::uint64_t>();
  read.progress.episodes = saved.at("episodes").get<std::uint64_t>();
  read.progress.lesson = saved.at("lesson").get<int>();
  read.progress.smoothed_reward = number("smoothed_reward");
  read.progress.reward = number("reward");
  read.progress.spl = number("spl");
  read.progress.episodes_to_spl95 = optional("episodes_to_spl95");
  read.progress.steps_to_spl95 = optional("steps_to_spl95");
  read.lesson_episodes = saved.at("lesson_episodes").get<std::uint64_t>();
  read.recent = saved.at("recent").get<std::vector<std::array<double, 2>>>();
  read.recent_next = saved.at("recent_next").get<std::size_t>();
  read.recent_steps = saved.value("recent_steps", std::deque<int>());  // older checkpoints lack it
  read.generation = saved.at("cut").get<std::uint64_t>();
  if (read.progress.lesson < 0 || read.progress.lesson >= static_cast<int>(lessons.size()) ||
      read.recent.size() > kRecent || read.recent_steps.size() > kRecent || read.recent_next >= kRecent)
    throw Error("its progress makes no sense", "checkpoint");
  read.progress.episode_length = mean_steps(read.recent_steps);
  return read;
}

void Trainer::Impl::continue_from(SavedProgress saved) {
  progress = saved.progress;
  lesson_episodes = saved.lesson_episodes;
  recent = std::move(saved.recent);
  recent_next = saved.recent_next;
  recent_steps = std::move(saved.recent_steps);
  generation = saved.generation;
}

std::string Trainer::identity() const { return impl_->identity().dump(); }

Checkpoint Trainer::Impl::checkpoint() const {
  Checkpoint checkpoint;
  checkpoint.header = identity();
  LearnerState state;
  learner->save(state);
  for (const auto& [name, tensor] : state.tensors) checkpoint.tensors["learner." + name] = tensor;
  checkpoint.tensors["reference"] = task.reference;
  nlohmann::json layout = nlohmann::json::array();
  for (const Tensor& tensor : network->tensors())
    layout.push_back({{"name", tensor.name}, {"rows", tensor.rows}, {"cols", tensor.cols}, {"offset", tensor.offset}});
  checkpoint.header["layout"] = layout;
  checkpoint.header["progress"] = progress_json();
  checkpoint.header["counters"] = state.counters;
  return checkpoint;
}

Checkpoint Trainer::checkpoint() {
  impl_->begin_generation();
  return impl_->checkpoint();
}

Checkpoint Trainer::snapshot() const {
  Checkpoint checkpoint = impl_->checkpoint();
  checkpoint.header["progress"]["cut"] = impl_->generation + 1;
  return checkpoint;
}

void Trainer::load(const Checkpoint& checkpoint) {
  Impl& p = *impl_;
  const nlohmann::json identity = p.identity();
  // Also a checkpoint that has them goes on with them alone.
  if (identity.contains("frozen") != checkpoint.header.contains("frozen")) {
    const auto list = [](const nlohmann::json& header) {
      return header.value("frozen", nlohmann::json::array()).dump();
    };
    throw Error("frozen was " + list(checkpoint.header) + ", now it is " + list(identity), "checkpoint",
                "go on with the same options, or start a new run");
  }
  for (const auto& [key, wanted] : identity.items()) {
    const auto found = checkpoint.header.find(key);
    if (found == checkpoint.header.end()) throw Error("has no '" + key + "'", "checkpoint");
    if (*found == wanted) continue;
    std::string what = key, was = found->dump(), now = wanted.dump();
    if (wanted.is_object() && found->is_object())  // name the one that differs
      for (const auto& [inner, value] : wanted.items())
        if (!found->contains(inner) || found->at(inner) != value) {
          what = key + "." + inner;
          was = found->contains(inner) ? found->at(inner).dump() : "missing";
          now = value.dump();
          break;
        }
    throw Error(what + " was " + was + ", now it is " + now, "checkpoint",
                "go on with the same options, or start a new run");
  }
  const auto reference = checkpoint.tensors.find("reference");
  if (reference == checkpoint.tensors.end() || reference->second != p.task.reference)
    throw Error("the training route's features are others than those it was made with", "checkpoint",
                "go on with the same data, or start a new run");
  try {
    LearnerState state;
    state.counters = checkpoint.header.at("counters").get<std::map<std::string, std::uint64_t>>();
    for (const auto& [name, tensor] : checkpoint.tensors)
      if (name.starts_with("learner.")) state.tensors[name.substr(8)] = tensor.reshaped();
    SavedProgress saved = p.read_progress(checkpoint.header.at("progress"));
    p.learner->load(state);
    p.continue_from(std::move(saved));
  } catch (const nlohmann::json::exception& problem) {
    throw Error("the header lacks something: " + std::string(problem.what()), "checkpoint");
  }
  p.collector->reset_all(p.generation, p.lesson().frames);
}

}  // namespace citylearn
