// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>

#include "core/wire/messages.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/environment.h"
#include "tests/support/data/real_data.h"

namespace citylearn::testing {

/// A route whose frame i shows the vector (i, i + 0.5).
inline Traversal small_traversal(int frames) {
  Traversal traversal;
  traversal.dataset = "test";
  traversal.name = "line";
  traversal.frames = frames;
  traversal.dimension = 2;
  for (int i = 0; i < frames; ++i) {
    traversal.features.push_back(static_cast<float>(i));
    traversal.features.push_back(static_cast<float>(i) + 0.5f);
    traversal.positions.push_back(10.0f * static_cast<float>(i));
  }
  return traversal;
}

inline msg::TaskSettings settings(msg::Mode mode, std::uint32_t frames, std::uint32_t max_steps,
                                  std::uint64_t seed = 1) {
  msg::TaskSettings settings;
  settings.task_mode() = mode;
  settings.settings().incarnation() = 1;
  settings.settings().version() = 1;
  settings.frames() = frames;
  settings.max_steps() = max_steps;
  settings.seed() = seed;
  settings.tasks() = mode == msg::EVALUATE ? 10 : 0;
  return settings;
}

inline std::unique_ptr<Dataset> make_dataset(const std::string& name, const std::string& folder = "",
                                             const std::map<std::string, double>& parameters = {}) {
  const auto& entry = DatasetRegistry::instance().find("dataset", name);
  return entry.create(Parameters(name, entry.parameters, parameters), folder);
}

}  // namespace citylearn::testing
