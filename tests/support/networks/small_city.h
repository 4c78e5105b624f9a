// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "env_service/environment.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/support/files.h"

namespace citylearn {

/// A route of frames that look nothing like one another.
inline Traversal small_city(int frames = 16, int dimension = 12) {
  Traversal city;
  city.dataset = "test";
  city.name = "city";
  city.frames = frames;
  city.dimension = dimension;
  Random random{77};
  for (int frame = 0; frame < frames; ++frame) {
    Vector<float> feature(dimension);
    for (float& value : feature) value = static_cast<float>(random.normal());
    feature.normalize();
    city.features.insert(city.features.end(), feature.begin(), feature.end());
  }
  city.positions.assign(static_cast<std::size_t>(frames), 0.0f);
  return city;
}

/// The same places under another condition.
inline Traversal other_season(Traversal city) {
  city.name = "other season";
  float move = 0;
  for (float& value : city.features) value = 0.5f * value + (move = 0.2f - move);
  return city;
}

/// A route as several traversals show it, or one.
struct Cities : std::vector<const Traversal*> {
  using std::vector<const Traversal*>::vector;
  Cities(const Traversal& city) : vector{&city} {}
};

inline NetworkTask task_of(const Cities& cities) {
  const Traversal& city = *cities.front();
  NetworkTask task{city.dimension, city.frames, {}};
  if (city.streets) task.streets = std::make_shared<const StateMap>(*city.streets, city.rule, msg::MAX_FRAMES);
  task.reference.resize(city.dimension, city.frames * static_cast<std::ptrdiff_t>(cities.size()));
  std::ptrdiff_t first = 0;
  for (const Traversal* one : cities) {
    task.reference.middleCols(first, city.frames) =
        Eigen::Map<const Matrix<float>>(one->features.data(), city.dimension, city.frames);
    first += city.frames;
  }
  return task;
}

/// Environments and the trainer that they serve, joined without a wire.
class Loop {
 public:
  /// So many environments, on the cities in turn.
  Loop(const Cities& cities, const TrainerOptions& options, int environments = 1, int agents = 4,
       const Imperfections& imperfections = {})
      : trainer(options, task_of(cities)) {
    for (int id = 0; id < environments; ++id) {
      const int experience = id % static_cast<int>(cities.size());
      environments_.try_emplace(id, *cities[static_cast<std::size_t>(experience)], agents, imperfections);
      trainer.add(id, agents, experience);
    }
  }

  /// Collects one segment and learns from it. `backwards`: the last environment's observations come first.
  UpdateFigures update(bool backwards = false) {
    const bool anew = trainer.generation() != generation_ || !begun_;
    generation_ = trainer.generation();
    begun_ = true;
    if (backwards)
      for (auto entry = environments_.rbegin(); entry != environments_.rend(); ++entry)
        collect(entry->first, entry->second, anew);
    else
      for (auto& [id, environment] : environments_) collect(id, environment, anew);
    return trainer.update();
  }

  Trainer trainer;

 private:
  void collect(int id, Environment& environment, bool anew) {
    msg::Observation observation;
    std::vector<std::uint8_t> choice;
    if (anew) {
      msg::TaskSettings settings;
      trainer.settings(id, settings);
      environment.reset(settings);
    } else {
      trainer.resume(id, choice);
      environment.step(choice);
    }
    while (true) {
      environment.observe(observation);
      if (!trainer.act(id, observation, choice)) return;
      environment.step(choice);
    }
  }

  std::map<int, Environment> environments_;
  std::uint64_t generation_ = 0;
  bool begun_ = false;
};

/// Trainings with one seed are the same to the bit, whichever environment comes first; with another seed they are not.
inline void expect_reproducible(const Cities& city, const TrainerOptions& options, int environments, int updates) {
  TrainerOptions reseeded = options;
  ++reseeded.seed;
  Loop one(city, options, environments), other(city, options, environments), third(city, reseeded, environments);
  for (int i = 0; i < updates; ++i) {
    one.update();
    other.update(/*backwards=*/i % 2 == 0);
    third.update();
  }
  EXPECT_EQ(one.trainer.agent().parameters, other.trainer.agent().parameters);
  EXPECT_NE(one.trainer.agent().parameters, third.trainer.agent().parameters);
  EXPECT_EQ(one.trainer.progress().episodes, other.trainer.progress().episodes);
  EXPECT_EQ(one.trainer.progress().spl, other.trainer.progress().spl);
  const auto segment = static_cast<std::uint64_t>(options.trainer_parameters.at("segment"));
  EXPECT_EQ(one.trainer.progress().steps, segment * 4 * static_cast<std::uint64_t>(environments * updates));
}

/// A training that goes on from the file of its checkpoint ends with the same bytes as one that goes straight on.
inline void expect_resumable(const Cities& city, const TrainerOptions& options, int before, int after) {
  const testing::Folder folder;
  const std::string middle = folder / "middle", straight = folder / "straight", resumed = folder / "resumed";
  Loop loop(city, options, 2), again(city, options, 2);
  for (int i = 0; i < before; ++i) loop.update();
  write_checkpoint(middle, loop.trainer.checkpoint());
  again.trainer.load(read_checkpoint(middle));
  EXPECT_EQ(again.trainer.progress().updates, static_cast<std::uint64_t>(before));
  for (int i = 0; i < after; ++i) {
    loop.update();
    again.update();
  }
  write_checkpoint(straight, loop.trainer.checkpoint());
  write_checkpoint(resumed, again.trainer.checkpoint());
  EXPECT_EQ(testing::contents(straight), testing::contents(resumed));
  EXPECT_NE(testing::contents(straight), testing::contents(middle));
}

}  // namespace citylearn
