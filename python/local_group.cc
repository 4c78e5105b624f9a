// SPDX-License-Identifier: Apache-2.0
#include "env_service/environment.h"
#include "python/env_group.h"
#include "python/evaluation.h"

namespace citylearn::python {
namespace {

class LocalGroup : public EnvGroup {
 public:
  LocalGroup(const Recording& recording, int agents, int services)
      : environments_(services, Environment(recording.traversal, agents, recording.imperfections, recording.goals)) {
    const Traversal& traversal = recording.traversal;
    shape_ = {traversal.name,      agents * services, std::vector(static_cast<std::size_t>(services), agents),
              traversal.dimension, traversal.frames,  streets_of(recording)};
  }

  const Shape& shape() const override { return shape_; }

  void reset(const msg::TaskSettings& settings, const Seeds& seeds) override {
    msg::TaskSettings own = settings;
    own.by_reference() = true;  // the features are here
    first_frame_ = settings.first_frame();
    for (std::size_t i = 0; i < environments_.size(); ++i) {
      if (!seeds[i]) continue;
      own.seed() = *seeds[i];
      environments_[i].reset(own);
    }
  }

  void send(std::span<const std::uint8_t> actions) override {
    for (Environment& environment : environments_) {
      const auto agents = static_cast<std::size_t>(environment.agents());
      environment.step(actions.first(agents));
      actions = actions.subspan(agents);
    }
  }

  void receive(const Batch& batch, const Interrupt& /*interrupt*/) override {
    std::size_t row = 0;
    for (const Environment& environment : environments_) {
      environment.observe(seen_);
      write_rows(seen_, first_frame_, static_cast<std::size_t>(shape_.features), row, batch,
                 [&](std::size_t agent) { return environment.feature(static_cast<int>(seen_.frame()[agent])).data(); });
      row += static_cast<std::size_t>(environment.agents());
    }
  }

 private:
  std::vector<Environment> environments_;
  Shape shape_;
  std::uint32_t first_frame_ = 0;
  msg::Observation seen_;
};

}  // namespace

std::unique_ptr<EnvGroup> make_local_group(const Recording& recording, int agents, int services) {
  return std::make_unique<LocalGroup>(recording, agents, services);
}

}  // namespace citylearn::python
