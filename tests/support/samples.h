// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>

#include "core/wire/messages.h"
#include "core/wire/transfer.h"

namespace citylearn::testing {

/// How full a message is: everything empty or zero, something of everything, or every sequence and string at its bound.
enum class Size { kLeast, kTypical, kMost };

/// Gives each field a value of its own, so that two fields that change places are noticed.
class Filler {
 public:
  explicit Filler(Size size) : size_(size) {}

  template <class Number>
  Number number() {
    ++count_;
    if (size_ == Size::kLeast) return Number{};
    if (size_ == Size::kTypical) return static_cast<Number>(count_ * 7 + 1);
    if constexpr (std::is_floating_point_v<Number>)
      return static_cast<Number>(-1e30 - count_ * 1e28);
    else
      return static_cast<Number>(std::numeric_limits<Number>::max() - static_cast<Number>(count_));
  }
  bool boolean() { return size_ != Size::kLeast; }
  std::string text(std::size_t bound) {
    ++count_;
    const std::size_t length = size_ == Size::kLeast ? 0 : size_ == Size::kTypical ? bound / 3 : bound;
    std::string text(length, static_cast<char>('a' + count_ % 26));
    if (length > 1) text.replace(0, 2, "\xC3\xA9");  // two bytes, one letter
    return text;
  }
  template <class T>
  std::vector<T> sequence(std::size_t typical, std::size_t bound) {
    ++count_;
    std::vector<T> sequence(size_ == Size::kLeast ? 0 : size_ == Size::kTypical ? typical : bound);
    for (std::size_t i = 0; i < sequence.size(); ++i) sequence[i] = static_cast<T>((i + 1) * (count_ + 2));
    return sequence;
  }
  std::vector<std::uint8_t> actions(std::size_t typical, std::size_t bound, bool none) {
    std::vector<std::uint8_t> actions = sequence<std::uint8_t>(typical, bound);
    for (std::uint8_t& action : actions)
      action = static_cast<std::uint8_t>(action % 4 == 3 ? (none ? kNoAction : kStay) : action % 4);
    return actions;
  }
  bool most() const { return size_ == Size::kMost; }
  bool least() const { return size_ == Size::kLeast; }

 private:
  Size size_;
  int count_ = 0;
};

inline void fill(Filler& f, msg::Header& m) {
  m.protocol(msg::PROTOCOL);
  m.run(f.text(64));
  m.sender(f.text(64));
  m.incarnation(f.number<std::uint64_t>());
  m.message(f.number<std::uint64_t>());
}

inline void fill(Filler& f, msg::SettingsId& m) {
  m.incarnation(f.number<std::uint64_t>());
  m.version(f.number<std::uint32_t>());
}

inline void fill(Filler& f, msg::Observation& m) {
  fill(f, m.header());
  fill(f, m.settings());
  m.step(f.number<std::uint64_t>());
  m.traversal(f.text(64));
  m.traversal_hash(f.number<std::uint64_t>());
  m.by_reference(f.boolean());
  m.encoder_incarnation(f.number<std::uint64_t>());
  m.frame(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.position(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.goal(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.previous_action(f.actions(16, msg::MAX_AGENTS, true));
  m.allowed(f.sequence<std::uint8_t>(16, msg::MAX_AGENTS));
  m.flags(f.sequence<std::uint8_t>(16, msg::MAX_AGENTS));
  m.reward(f.sequence<float>(16, msg::MAX_AGENTS));
  m.features(f.sequence<float>(16 * 64, msg::MAX_FEATURES));
  m.feature_dimension(m.frame().empty() ? 0 : static_cast<std::uint32_t>(m.features().size() / m.frame().size()));
}

inline void fill(Filler& f, msg::Action& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  m.environment_incarnation(f.number<std::uint64_t>());
  fill(f, m.settings());
  m.step(f.number<std::uint64_t>());
  m.choice(f.actions(16, msg::MAX_AGENTS, false));
}

inline void fill(Filler& f, msg::EpisodeStat& m) {
  fill(f, m.header());
  fill(f, m.settings());
  m.episode(f.number<std::uint64_t>());
  m.acknowledged(f.number<std::uint64_t>());
  m.agent(f.number<std::uint32_t>());
  m.evaluation(f.boolean());
  m.task(f.number<std::uint32_t>());
  m.traversal(f.text(64));
  m.start(f.number<std::uint32_t>());
  m.goal(f.number<std::uint32_t>());
  m.steps(f.number<std::uint32_t>());
  m.shortest(f.number<std::uint32_t>());
  m.reward(f.number<float>());
  m.completed(f.boolean());
  m.shuffled(f.boolean());
  m.policy(f.text(64));
  m.update(f.number<std::uint64_t>());
  m.job(f.number<std::uint64_t>());
  m.path(f.sequence<std::uint8_t>(11, msg::MAX_PATH));
  m.steps(static_cast<std::uint32_t>(m.path().size() * 4));
}

inline void fill(Filler& f, msg::EpisodeAcknowledgement& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  m.environment_incarnation(f.number<std::uint64_t>());
  m.episode(f.number<std::uint64_t>());
  m.leaving(f.boolean());
}

inline void fill(Filler& f, msg::ServiceStatus& m) {
  fill(f, m.header());
  m.service(f.text(32));
  m.host(f.text(64));
  m.middleware(f.text(32));
  m.process(f.number<std::uint32_t>());
  m.service_state(f.least() ? msg::STARTING : f.most() ? msg::FAILED : msg::RUNNING);
  m.activity(f.text(256));
  m.uptime(f.number<double>());
  m.rate(f.number<float>());
  m.received(f.number<std::uint64_t>());
  m.repeated(f.number<std::uint64_t>());
  m.resent(f.number<std::uint64_t>());
  m.rejected(f.number<std::uint64_t>());
  m.foreign(f.number<std::uint64_t>());
  m.alarm(f.text(256));
}

inline void fill(Filler& f, msg::TaskSettings& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  fill(f, m.settings());
  m.task_mode(f.least() ? msg::IDLE : f.most() ? msg::EVALUATE : msg::TRAIN);
  m.lesson(f.number<std::uint32_t>());
  m.first_frame(f.number<std::uint32_t>());
  m.frames(f.number<std::uint32_t>());
  m.max_steps(f.number<std::uint32_t>());
  m.seed(f.number<std::uint64_t>());
  m.tasks(f.number<std::uint32_t>());
  m.shuffle(f.boolean());
  m.policy(f.text(64));
  m.update(f.number<std::uint64_t>());
  m.job(f.number<std::uint64_t>());
  m.by_reference(f.boolean());
}

inline void fill(Filler& f, msg::TrainingStat& m) {
  fill(f, m.header());
  m.job(f.number<std::uint64_t>());
  m.update(f.number<std::uint64_t>());
  m.steps(f.number<std::uint64_t>());
  m.episodes(f.number<std::uint64_t>());
  m.lesson(f.number<std::uint32_t>());
  m.wall(f.number<double>());
  m.steps_per_second(f.number<float>());
  m.reward(std::numeric_limits<float>::quiet_NaN());
  m.spl(f.number<float>());
  m.policy_loss(f.number<float>());
  m.value_loss(f.number<float>());
  m.entropy(f.number<float>());
  m.divergence(f.number<float>());
  m.clipped(f.number<float>());
  m.gradient_norm(std::numeric_limits<float>::infinity());
  m.learning_rate(f.number<float>());
  m.lag(f.number<float>());
}

inline void fill(Filler& f, msg::RunInfo& m) {
  fill(f, m.header());
  m.agent(f.text(64));
  m.learner(f.text(64));
  m.seed(f.number<std::uint64_t>());
  m.job(f.number<std::uint64_t>());
  m.updates(f.number<std::uint64_t>());
  m.ended(f.boolean());
  m.manifest(f.sequence<std::uint8_t>(2000, msg::MAX_CHUNK));
}

inline void fill(Filler& f, msg::TrainingStatRequest& m) {
  fill(f, m.header());
  m.policy(f.text(64));
  m.policy_incarnation(f.number<std::uint64_t>());
  m.job(f.number<std::uint64_t>());
  m.first(f.number<std::uint64_t>());
  m.last(f.number<std::uint64_t>());
}

inline void fill(Filler& f, msg::Scene& m) {
  fill(f, m.header());
  fill(f, m.settings());
  m.task_mode(f.least() ? msg::IDLE : f.most() ? msg::EVALUATE : msg::TRAIN);
  m.policy(f.text(64));
  m.traversal(f.text(64));
  m.traversal_hash(f.number<std::uint64_t>());
  m.first_frame(f.number<std::uint32_t>());
  m.frames(f.number<std::uint32_t>());
  m.step(f.number<std::uint64_t>());
  m.frame(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.position(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.start(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.goal(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.steps(f.sequence<std::uint32_t>(16, msg::MAX_AGENTS));
  m.flags(f.sequence<std::uint8_t>(16, msg::MAX_AGENTS));
}

inline void fill(Filler& f, msg::MapRequest& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  m.hash(f.number<std::uint64_t>());
  m.first(f.number<std::uint32_t>());
}

inline void fill(Filler& f, msg::MapChunk& m) {
  fill(f, m.header());
  m.hash(f.number<std::uint64_t>());
  m.frames(msg::MAX_FRAMES);
  m.first(f.least() ? 0 : 17);
  m.position(f.sequence<float>(128, msg::MAX_PLACES));
  m.latitude(f.sequence<double>(128, msg::MAX_PLACES));
  m.longitude(f.sequence<double>(128, msg::MAX_PLACES));
}

inline void fill(Filler& f, msg::PolicyParameters& m) {
  fill(f, m.header());
  m.version(f.number<std::uint64_t>());
  m.agent(f.text(64));
  m.data(f.sequence<std::uint8_t>(4096, msg::MAX_CHUNK));
  m.total_bytes(m.data().size() * 3);
  m.hash(f.number<std::uint64_t>());
  m.chunk(f.least() ? 0 : 1);
  m.chunks(f.least() ? 1 : 3);
}

inline void fill(Filler& f, msg::LearnerInfo& m) {
  fill(f, m.header());
  m.training(f.boolean());
  m.traversal(f.text(64));
  m.traversal_hash(f.number<std::uint64_t>());
  m.feature_dimension(f.number<std::uint32_t>());
  m.first_frame(f.number<std::uint32_t>());
  m.frames(f.number<std::uint32_t>());
  m.lesson(f.number<std::uint32_t>());
  m.lesson_frames(f.number<std::uint32_t>());
  m.max_steps(f.number<std::uint32_t>());
  m.agent(f.text(64));
  m.network(f.text(1024));
  m.seed(f.number<std::uint64_t>());
  m.job(f.number<std::uint64_t>());
  m.steps(f.number<std::uint32_t>());
  m.window(f.number<std::uint32_t>());
  m.noise_frame(f.number<double>());
  m.noise_place(f.number<double>());
  m.noise_episode(f.number<double>());
  m.version(f.number<std::uint64_t>());
  m.total_bytes(f.number<std::uint64_t>());
  m.hash(f.number<std::uint64_t>());
  m.chunks(f.number<std::uint32_t>());
}

inline void fill(Filler& f, msg::ActorStatus& m) {
  fill(f, m.header());
  m.learner(f.text(64));
  m.learner_incarnation(f.number<std::uint64_t>());
  m.version(f.number<std::uint64_t>());
  m.environments(f.sequence<std::uint64_t>(3, msg::MAX_SERVED));
  m.unacknowledged(f.number<std::uint32_t>());
  m.waiting(f.boolean());
  m.waited(f.number<double>());
}

inline void fill(Filler& f, msg::Trajectory& m) {
  constexpr std::size_t kSteps = 32, kDimension = 64;
  fill(f, m.header());
  m.learner(f.text(64));
  m.learner_incarnation(f.number<std::uint64_t>());
  m.number(f.number<std::uint64_t>());
  m.environment(f.text(64));
  m.agent(f.number<std::uint32_t>());
  fill(f, m.settings());
  m.step(f.number<std::uint64_t>());
  m.lesson(f.number<std::uint32_t>());
  m.version(f.number<std::uint64_t>());
  m.state(f.sequence<float>(128, msg::MAX_STATE));
  m.action(f.actions(kSteps, msg::MAX_STEPS, false));
  m.log_probability(f.sequence<float>(kSteps, msg::MAX_STEPS));
  m.reward(f.sequence<float>(kSteps, msg::MAX_STEPS));
  m.ended(f.actions(kSteps, msg::MAX_STEPS, false));
  m.final_value(f.sequence<float>(kSteps, msg::MAX_STEPS));
  m.shown(f.sequence<std::int32_t>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  m.position(f.sequence<std::uint32_t>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  m.goal(f.sequence<std::uint32_t>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  m.previous_action(f.actions(kSteps + 1, msg::MAX_STEPS_AND_ONE, true));
  m.allowed(f.sequence<std::uint8_t>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  m.first(f.sequence<std::uint8_t>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  m.value(f.sequence<float>(kSteps + 1, msg::MAX_STEPS_AND_ONE));
  if (f.least()) {  // no step is one observation
    m.shown().resize(1);
    m.position().resize(1);
    m.goal().resize(1);
    m.previous_action().resize(1);
    m.allowed().resize(1);
    m.first().resize(1);
    m.value().resize(1);
  }
  m.feature_dimension(f.least()  ? 0
                      : f.most() ? msg::MAX_TRAJECTORY / msg::MAX_STEPS_AND_ONE
                                 : static_cast<std::uint32_t>(kDimension));
  m.features(std::vector<float>(m.shown().size() * m.feature_dimension(), 0.25f));
}

inline void fill(Filler& f, msg::TrajectoryAcknowledgement& m) {
  fill(f, m.header());
  m.actor(f.text(64));
  m.actor_incarnation(f.number<std::uint64_t>());
  m.number(f.number<std::uint64_t>());
  m.limit(f.number<std::uint64_t>());
}

inline void fill(Filler& f, msg::ParametersRequest& m) {
  fill(f, m.header());
  m.learner(f.text(64));
  m.version(f.number<std::uint64_t>());
  m.chunks(f.sequence<std::uint32_t>(5, msg::MAX_PARTS_ASKED));
}

inline void fill(Filler& f, msg::TraversalInfo& m) {
  fill(f, m.header());
  fill(f, m.settings());
  m.dataset(f.text(64));
  m.traversal(f.text(64));
  m.condition(f.text(64));
  m.hash(f.number<std::uint64_t>());
  m.frames(f.least() ? 1 : f.most() ? msg::MAX_FRAMES : 500);
  m.feature_dimension(f.least() ? 0 : f.most() ? msg::MAX_DIMENSION : 64);
  m.agents(f.least() ? 1 : f.most() ? msg::MAX_AGENTS : 16);
  m.chunks(f.number<std::uint32_t>());
  m.by_reference(f.boolean());
  m.images(f.boolean());
  m.encoder(f.text(256));
  m.encoder_service(f.text(64));
  m.encoder_incarnation(f.number<std::uint64_t>());
}

inline void fill(Filler& f, msg::TraversalRequest& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  m.hash(f.number<std::uint64_t>());
  m.feature_dimension(f.number<std::uint32_t>());
  m.chunks(f.sequence<std::uint32_t>(5, msg::MAX_CHUNKS_ASKED));
}

inline void fill(Filler& f, msg::TraversalChunk& m) {
  fill(f, m.header());
  m.hash(f.number<std::uint64_t>());
  m.data(f.sequence<std::uint8_t>(10 * 65 * 4, msg::MAX_CHUNK));
  if (f.least()) m.data().resize(sizeof(float));  // one frame, no features
  m.frames(f.least() ? 1 : f.most() ? msg::MAX_FRAMES : 10);
  m.feature_dimension(f.least() ? 0 : f.most() ? msg::MAX_DIMENSION : 64);
  m.chunk(f.most() ? ChunkLayout(msg::MAX_FRAMES, msg::MAX_DIMENSION).chunks() - 2 : 0);
}

inline void fill(Filler& f, msg::ImageRequest& m) {
  fill(f, m.header());
  m.environment(f.text(64));
  m.hash(f.number<std::uint64_t>());
  m.frames(f.sequence<std::uint32_t>(5, msg::MAX_FRAMES_ASKED));
  m.first_chunk(f.number<std::uint32_t>());
}

inline void fill(Filler& f, msg::ImageChunk& m) {
  fill(f, m.header());
  m.hash(f.number<std::uint64_t>());
  m.frame(f.number<std::uint32_t>());
  m.data(f.sequence<std::uint8_t>(5000, msg::MAX_CHUNK));
  m.chunk(f.least() ? 0 : 2);
  m.total_bytes(f.least() ? 0 : static_cast<std::uint32_t>(2 * msg::MAX_CHUNK + m.data().size()));
  m.name(f.text(200));
}

template <class Message>
Message sample_of(Size size) {
  Filler filler(size);
  Message message;
  fill(filler, message);
  return message;
}

template <class Message>
Bytes encoded(const Message& message) {
  Bytes bytes;
  encode(message, bytes);
  return bytes;
}

/// Equal in every field, NaN included: the same bytes.
template <class Message>
bool equal(const Message& a, const Message& b) {
  return encoded(a) == encoded(b);
}

/// Calls `visit.template operator()<Message>()` for every message type.
template <class Visit>
void for_each_message(Visit visit) {
  const auto each = [&]<class... Messages>(std::tuple<Messages...>*) { (visit.template operator()<Messages>(), ...); };
  each(static_cast<
       std::tuple<msg::Observation, msg::Action, msg::EpisodeStat, msg::EpisodeAcknowledgement, msg::ServiceStatus,
                  msg::TaskSettings, msg::TrainingStat, msg::PolicyParameters, msg::TraversalInfo,
                  msg::TraversalRequest, msg::TraversalChunk, msg::ImageRequest, msg::ImageChunk, msg::LearnerInfo,
                  msg::ActorStatus, msg::Trajectory, msg::TrajectoryAcknowledgement, msg::ParametersRequest,
                  msg::RunInfo, msg::TrainingStatRequest, msg::Scene, msg::MapRequest, msg::MapChunk>*>(nullptr));
}

}  // namespace citylearn::testing
