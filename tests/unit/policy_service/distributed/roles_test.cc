// SPDX-License-Identifier: Apache-2.0
// What learner and actors exchange, without the wire.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "policy_service/distributed/parameter_fetch.h"
#include "policy_service/distributed/trajectories.h"
#include "tests/support/env/env.h"
#include "tests/support/networks/small_city.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kSegmentSteps = 8, kSegmentAgents = 3;

/// Segments of a real network on a small city, each with the trajectories an actor would make of it.
class Segments {
 public:
  Segments()
      : network_(make()),
        collector_({.segment = kSegmentSteps, .sequence = kSegmentSteps, .noise_frame = 0.1}, task_, *network_,
                   workers_) {
    Random random{3};
    network_->initialise(random, parameters_);
    collector_.add(0, kSegmentAgents);
    environment_.reset(settings(msg::TRAIN, 16, 6, collector_.environment_seed(0)));
  }
  /// Collects the next one; rollout() holds it until the next call.
  void next() {
    std::vector<std::uint8_t> choice;
    msg::Observation observation;
    if (begun_) {
      collector_.begin_segment(0);
      collector_.resume(0, parameters_, choice);
      environment_.step(choice);
    }
    begun_ = true;
    for (environment_.observe(observation); collector_.act(0, observation, parameters_, choice);
         environment_.observe(observation))
      environment_.step(choice);
    ++count_;
  }
  const Rollout& rollout() { return collector_.rollout(0); }
  const std::vector<FinishedEpisode>& finished() const { return collector_.finished(0); }
  msg::Trajectory trajectory(int agent, std::uint64_t number, std::uint64_t version = 0, const char* actor = "a") {
    msg::Trajectory made;
    made.header().protocol() = msg::PROTOCOL;
    made.header().session() = "session";
    made.header().sender() = actor;
    made.header().incarnation() = 1;
    made.log().number() = number;
    made.log().first() = 1;
    made.environment() = "env";
    made.agent() = static_cast<std::uint32_t>(agent);
    made.step() = static_cast<std::uint64_t>((count_ - 1) * kSegmentSteps);
    made.version() = version;
    pack(rollout(), agent, made);
    return made;
  }
  TrajectoryShape shape() const { return {kSegmentSteps, 12, network_->state_size(), 16, task_.map()}; }

 private:
  std::unique_ptr<AgentNetwork<float>> make() const {
    const auto& entry = NetworkRegistry<float>::instance().find("network", "place_filter");
    return entry.create(Parameters("network", entry.parameters, {}), task_);
  }
  Traversal city_ = small_city();
  NetworkTask task_ = task_of(city_);
  std::unique_ptr<AgentNetwork<float>> network_;
  Vector<float> parameters_;
  WorkerPool workers_{2};
  Collector collector_;
  Environment environment_{city_, kSegmentAgents};
  bool begun_ = false;
  int count_ = 0;
};

struct Trajectories : ::testing::Test {
  using Taken = TrajectoryQueue::Taken;
  Trajectories() { segments.next(); }
  Segments segments;  ///< the first one is collected
};

TEST_F(Trajectories, ARolloutGoesRoundThroughThem) {
  TrajectoryQueue queue(segments.shape(), 100);
  segments.next();  // with recurrent states and episodes that go on from before
  for (int agent = 0; agent < kSegmentAgents; ++agent) {
    Bytes bytes;
    encode(segments.trajectory(agent, static_cast<std::uint64_t>(agent) + 1), bytes);
    msg::Trajectory received;
    decode(std::span<const std::byte>(bytes), received);
    EXPECT_EQ(queue.take(received, 0), Taken::kTaken);
  }
  ASSERT_TRUE(queue.ready(kSegmentAgents, 0, 0, 0));
  Rollout got;
  EXPECT_EQ(queue.assemble(kSegmentAgents, 0, 16, got), 0);
  const Rollout& sent = segments.rollout();
  EXPECT_EQ(got.states, sent.states);
  EXPECT_EQ(got.action, sent.action);
  EXPECT_EQ(got.log_probability, sent.log_probability);
  EXPECT_EQ(got.value, sent.value);
  EXPECT_EQ(got.reward, sent.reward);
  EXPECT_EQ(got.ended, sent.ended);
  EXPECT_EQ(got.last_value, sent.last_value);
  EXPECT_NE(std::count(sent.ended.begin(), sent.ended.end(), Rollout::kTruncated), 0);
  for (std::size_t i = 0; i < sent.ended.size(); ++i) {
    if (sent.ended[i] == Rollout::kTruncated) {
      EXPECT_EQ(got.final_value[i], sent.final_value[i]);
    }
  }
  for (const auto& [a, b] : {std::pair{&got.inputs, &sent.inputs}, std::pair{&got.next, &sent.next}}) {
    EXPECT_EQ(a->frames, b->frames);
    EXPECT_EQ(a->goal, b->goal);
    EXPECT_EQ(a->position, b->position);
    EXPECT_EQ(a->previous_action, b->previous_action);
    EXPECT_EQ(a->allowed, b->allowed);
    EXPECT_EQ(a->first, b->first);
    for (std::size_t column = 0; column < a->goal.size(); ++column)
      EXPECT_EQ(a->features_of(static_cast<long>(column)), b->features_of(static_cast<long>(column)));
  }
}

TEST_F(Trajectories, EpisodesAreCountedAsACollectorCountsThem) {
  Segments begun;
  TrajectoryQueue queue(begun.shape(), 100);
  std::vector<double> expected, found;
  const auto sum_of = [](const FinishedEpisode& episode) {
    return episode.reward + 100 * episode.spl + 10000 * episode.steps;
  };
  std::uint64_t number = 0;
  for (int segment = 0; segment < 6; ++segment) {
    begun.next();
    for (const FinishedEpisode& episode : begun.finished()) expected.push_back(sum_of(episode));
    for (int agent = 0; agent < kSegmentAgents; ++agent) {
      msg::Trajectory trajectory = begun.trajectory(agent, ++number);
      ASSERT_EQ(queue.take(trajectory, 0), Taken::kTaken);
    }
  }
  for (const FinishedEpisode& episode : queue.finished()) found.push_back(sum_of(episode));
  std::sort(expected.begin(), expected.end());
  std::sort(found.begin(), found.end());
  EXPECT_GT(expected.size(), 10u);
  EXPECT_EQ(found, expected);
  EXPECT_TRUE(queue.finished().empty());
}

TEST_F(Trajectories, EachOnceAndInOrderWhateverTheWireDoes) {
  TrajectoryQueue queue(segments.shape(), 100);
  const auto send = [&](std::uint64_t number) {
    msg::Trajectory trajectory = segments.trajectory(0, number, number);
    return queue.take(trajectory, 100);
  };
  EXPECT_EQ(send(2), Taken::kTaken);
  EXPECT_EQ(queue.window("a").number, 0u) << "a gap is not acknowledged";
  EXPECT_EQ(send(4), Taken::kTaken);
  EXPECT_EQ(send(2), Taken::kRepeated);
  EXPECT_EQ(queue.size(), 0u);
  EXPECT_EQ(send(1), Taken::kTaken);
  EXPECT_EQ(queue.window("a").number, 2u);
  EXPECT_EQ(send(3), Taken::kTaken);
  EXPECT_EQ(send(1), Taken::kRepeated);
  EXPECT_EQ(queue.window("a").number, 4u);
  ASSERT_TRUE(queue.ready(4, 100, 0, 0));
  Rollout rollout;
  EXPECT_DOUBLE_EQ(queue.assemble(4, 100, 16, rollout), (99 + 98 + 97 + 96) / 4.0);
  EXPECT_EQ(send(4), Taken::kRepeated) << "learned from already";
  queue.register_actor("a", 2);
  EXPECT_EQ(queue.window("a").number, 0u) << "a new incarnation counts from 1";
  EXPECT_EQ(send(5), Taken::kRepeated) << "of the dead one";
}

TEST_F(Trajectories, AGapThatIsNeverFilledIsGivenUp) {
  TrajectoryQueue queue(segments.shape(), 100);
  const auto send = [&](std::uint64_t number, std::uint64_t first = 1) {
    msg::Trajectory trajectory = segments.trajectory(0, number);
    trajectory.log().first() = first;
    return queue.take(trajectory, 0);
  };
  for (const std::uint64_t number : {1u, 3u, 4u}) send(number);
  EXPECT_EQ(queue.window("a").number, 1u);
  EXPECT_EQ(send(3, 3), Taken::kRepeated) << "sent again";
  EXPECT_EQ(queue.window("a").number, 4u) << "2 was acknowledged in the learner's name";
  EXPECT_EQ(send(5, 3), Taken::kTaken);
  EXPECT_EQ(send(7, 7), Taken::kTaken) << "as was 6";
  EXPECT_EQ(queue.window("a").number, 7u);
  EXPECT_EQ(queue.size(), 5u) << "1, 3, 4, 5 and 7";
  EXPECT_EQ(send(200, 200), Taken::kNoRoom) << "nobody was told that there is room for 199";
  EXPECT_EQ(send(8, 2), Taken::kTaken);
}

TEST_F(Trajectories, TheRoomIsBoundedAndShared) {
  TrajectoryQueue queue(segments.shape(), 8);
  queue.share_among(2);
  const auto send = [&](const char* actor, std::uint64_t number) {
    msg::Trajectory trajectory = segments.trajectory(1, number, 0, actor);
    return queue.take(trajectory, 0);
  };
  queue.register_actor("a", 1);
  EXPECT_EQ(queue.window("a").limit, 4u);
  for (std::uint64_t number = 1; number <= 4; ++number) EXPECT_EQ(send("a", number), Taken::kTaken);
  EXPECT_EQ(send("a", 5), Taken::kNoRoom);
  EXPECT_EQ(send("b", 1), Taken::kTaken) << "a greedy one leaves the other's room alone";
  EXPECT_EQ(queue.window("a").limit, 4u);
  ASSERT_TRUE(queue.ready(2, 0, 0, 0));
  Rollout rollout;
  queue.assemble(2, 0, 16, rollout);
  EXPECT_EQ(queue.window("a").limit, 6u);
  EXPECT_EQ(send("a", 5), Taken::kTaken);
}

TEST_F(Trajectories, WhatIsTooOldOrOfAnotherLessonIsDroppedAndCounted) {
  TrajectoryQueue queue(segments.shape(), 8);
  for (std::uint64_t number = 1; number <= 3; ++number) {
    msg::Trajectory trajectory = segments.trajectory(0, number, number);
    queue.take(trajectory, 5);
  }
  EXPECT_FALSE(queue.ready(3, 5, 0, 3)) << "version 1 is 4 updates old";
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_EQ(queue.window("a").limit, 3u + 6u) << "what was dropped takes no room";
  EXPECT_TRUE(queue.ready(2, 5, 0, 3));
  EXPECT_FALSE(queue.ready(1, 5, 1, 3));
  EXPECT_EQ(queue.dropped(), 3u);
}

TEST_F(Trajectories, WhatDoesNotFitIsNamed) {
  TrajectoryQueue queue(segments.shape(), 8);
  const auto error = [&](auto change) {
    msg::Trajectory trajectory = segments.trajectory(0, 1);
    change(trajectory);
    return error_of([&] { queue.take(trajectory, 0); });
  };
  EXPECT_TRUE(contains(error([](auto& t) { t.version() = 1; }), "Trajectory.version"));
  EXPECT_TRUE(contains(error([](auto& t) { t.position()[2] = 16; }), "Trajectory.position"));
  EXPECT_TRUE(contains(error([](auto& t) { t.state().pop_back(); }), "Trajectory.state"));
  EXPECT_TRUE(contains(error([](auto& t) { t.features()[5] = std::nanf(""); }), "Trajectory.features"));
  EXPECT_TRUE(contains(error([](auto& t) { t.allowed()[0] = 1, t.action()[0] = kNext; }), "Trajectory.action"));
  EXPECT_EQ(queue.window("a").number, 0u);
  EXPECT_EQ(error([](auto&) {}), "");
  const std::string refusal = error_of([] { TrajectoryShape{256, 4096, 1, 2}.require_fits(); });
  EXPECT_TRUE(contains(refusal, "--trainer-sequence"));
  EXPECT_TRUE(contains(refusal, "at most 64"));
  EXPECT_NO_THROW((TrajectoryShape{64, 4096, 1, 2}.require_fits()));
}

/// Parameters of three chunks and a bit.
Vector<float> some_parameters(float scale) {
  Vector<float> values(3 * static_cast<int>(msg::MAX_CHUNK) / 4 + 5);
  for (int i = 0; i < values.size(); ++i) values(i) = scale * static_cast<float>(i);
  return values;
}

constexpr std::uint64_t kLearner = 77;  // its incarnation

ObjectBytes parameters_at(std::uint64_t version, const Vector<float>& values) {
  return parameters_object(kLearner, version, "test", values);
}

msg::ParametersChunk part_of(const ObjectBytes& all, std::uint32_t index) {
  msg::ParametersChunk chunk;
  all.fill(index, chunk);
  return chunk;
}

msg::LearnerInfo announcement(const ObjectBytes& all) {
  msg::LearnerInfo info;
  info.header().incarnation() = kLearner;
  info.agent() = "test";
  info.version() = all.key.item;
  info.total_bytes() = all.bytes.size();
  info.hash() = all.checksum;
  return info;
}

using Versions = std::set<std::uint64_t>;

TEST(ParameterFetch, AVersionCountsOnceItIsComplete) {
  const Vector<float> first = some_parameters(1), second = some_parameters(2);
  const ObjectBytes one = parameters_at(1, first), two = parameters_at(2, second);
  ASSERT_EQ(one.chunks(), 4u);
  ParameterFetch fetch(announcement(one), first.size());
  for (const std::uint32_t index : {2u, 0u, 2u, 3u}) EXPECT_TRUE(fetch.take(part_of(one, index)));
  EXPECT_EQ(fetch.newest(), nullptr);
  EXPECT_EQ(fetch.missing(), Versions{1});
  for (std::uint32_t index = 0; index < 3; ++index) EXPECT_TRUE(fetch.take(part_of(two, index)));
  EXPECT_EQ(fetch.missing(), (Versions{1, 2}));
  EXPECT_TRUE(fetch.take(part_of(one, 1)));
  ASSERT_NE(fetch.newest(), nullptr);
  EXPECT_EQ(fetch.newest()->version, 1u);
  EXPECT_EQ(fetch.newest()->values, first);
  EXPECT_TRUE(fetch.take(part_of(two, 3)));
  EXPECT_EQ(fetch.newest()->version, 2u);
  EXPECT_EQ(fetch.newest()->values, second);
  EXPECT_EQ(fetch.missing(), Versions{});
  EXPECT_TRUE(fetch.take(part_of(one, 0))) << "an old one changes nothing";
  EXPECT_EQ(fetch.missing(), Versions{});
}

TEST(ParameterFetch, AFasterLearnerDoesNotKeepAVersionFromBeingComplete) {
  const Vector<float> values = some_parameters(1);
  const ObjectBytes first = parameters_at(1, values);
  ParameterFetch fetch(announcement(first), values.size());
  for (std::uint64_t version = 1; version <= 50; ++version)  // each time one chunk comes before the next version
    fetch.take(part_of(parameters_at(version, values), static_cast<std::uint32_t>(version % 4)));
  EXPECT_EQ(fetch.missing(), (Versions{1, 50}));
  for (const std::uint32_t index : {0u, 2u, 3u}) fetch.take(part_of(first, index));
  EXPECT_EQ(fetch.newest()->version, 1u);
  EXPECT_EQ(fetch.missing(), Versions{50}) << "then the newest";
  msg::ParametersChunk none;
  none.hash() = kLearner;
  none.item() = 50;
  EXPECT_TRUE(fetch.take(none)) << "the learner has forgotten it";
  EXPECT_EQ(fetch.missing(), Versions{});
}

/// A learner that announces faster than its parameters come keeps nobody waiting for ever.
TEST(ParameterFetch, OnesThatFitOneChunkAreTakenThoughNewerOnesAreAnnounced) {
  const Vector<float> values = Vector<float>::Random(100);
  std::vector<ObjectBytes> versions;
  for (std::uint64_t version = 0; version < 5; ++version) versions.push_back(parameters_at(version, values));
  ParameterFetch fetch(announcement(versions[0]), values.size());
  for (const ObjectBytes& announced : versions) EXPECT_TRUE(fetch.expect(announcement(announced)));
  EXPECT_TRUE(fetch.take(part_of(versions[2], 0)));
  ASSERT_TRUE(fetch.newest());
  EXPECT_EQ(fetch.newest()->version, 2u);
  EXPECT_TRUE(fetch.take(part_of(versions[1], 0)));
  EXPECT_EQ(fetch.newest()->version, 2u);
}

TEST(ParameterFetch, OnesThatAreNotFiniteAreRefused) {
  Vector<float> values = some_parameters(1);
  values[values.size() - 1] = std::numeric_limits<float>::quiet_NaN();
  const ObjectBytes diverged = parameters_at(1, values);
  ParameterFetch fetch(announcement(diverged), values.size());
  for (std::uint32_t index = 0; index < diverged.chunks(); ++index)
    EXPECT_EQ(fetch.take(part_of(diverged, index)), index + 1 < diverged.chunks()) << index;
  EXPECT_FALSE(fetch.newest()) << "though their checksum is right";
}

TEST(ParameterFetch, DamagedAndForeignOnesAreRefused) {
  const Vector<float> values = some_parameters(1);
  const ObjectBytes all = parameters_at(7, values);
  ParameterFetch fetch(announcement(all), values.size()), other(announcement(all), values.size() + 1);
  EXPECT_FALSE(other.take(part_of(all, 0))) << "of another network";
  EXPECT_FALSE(other.expect(announcement(all)));
  for (std::uint32_t index = 0; index < 3; ++index) EXPECT_TRUE(fetch.take(part_of(all, index)));
  msg::ParametersChunk damaged = part_of(all, 3);
  damaged.data()[4] ^= 1;
  EXPECT_FALSE(fetch.take(damaged));
  EXPECT_EQ(fetch.newest(), nullptr);
  for (std::uint32_t index = 0; index < 4; ++index) EXPECT_TRUE(fetch.take(part_of(all, index)));
  ASSERT_NE(fetch.newest(), nullptr) << "asked for again, it is right";
  EXPECT_EQ(fetch.newest()->values, values);
}

}  // namespace
}  // namespace citylearn::testing
