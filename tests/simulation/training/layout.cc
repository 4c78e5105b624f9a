// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/layout.h"

#include <algorithm>

#include "core/util/error.h"
#include "core/util/random.h"
#include "core/util/text.h"

namespace citylearn::simulation {
namespace {

/// Returns all layouts, on a line and on streets.
std::vector<Layout> with_streets(std::vector<Layout> all) {
  const std::size_t lines = all.size();
  for (std::size_t i = 0; i < lines; ++i) {
    Layout layout = all[i];
    layout.name += "-streets";
    layout.meaning += "; on streets";
    layout.streets = true;
    all.push_back(layout);
  }
  return all;
}

}  // namespace

const std::vector<Layout>& layouts() {
  static const std::vector<Layout> all = with_streets({
      {.name = "lockstep", .meaning = "one policy_service acts and learns"},
      {.name = "actors", .meaning = "a learner and two actors", .actors = 2},
      {.name = "courier", .meaning = "one policy_service acts and learns tasks of three goals", .goals = 3},
      {.name = "courier-actors", .meaning = "a learner and two actors, tasks of three goals", .actors = 2, .goals = 3},
      {.name = "encoder",
       .meaning = "env_services with pictures, two encoder_services that share a store",
       .environments = 2,
       .encoders = 2,
       .updates = 10},
      {.name = "replay",
       .meaning = "all messages are recorded, and replayed to another dashboard",
       .replayed = true,
       .updates = 10},
      {.name = "all",
       .meaning = "a learner, two actors, two encoder_services, two dashboards; all is recorded and replayed",
       .environments = 2,
       .actors = 2,
       .encoders = 2,
       .dashboards = 2,
       .replayed = true,
       .updates = 10},
  });
  return all;
}

const Layout& find_layout(const std::string& name) {
  const auto found =
      std::find_if(layouts().begin(), layouts().end(), [&](const Layout& layout) { return layout.name == name; });
  if (found == layouts().end()) throw Error("unknown layout", name, "one of " + joined(layouts(), &Layout::name));
  return *found;
}

const Layout& draw_layout(std::uint64_t seed) { return layouts()[Random{seed, 0x1A40}.below(layouts().size())]; }

}  // namespace citylearn::simulation
