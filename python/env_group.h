// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/task/state_map.h"
#include "core/wire/messages.h"
#include "core/wire/node_options.h"
#include "python/options.h"

namespace citylearn::python {

/// Memory of numpy arrays, row-major, that receives the observations of B agents.
struct Batch {
  float* features;                ///< B x D
  std::int64_t* goal;             ///< B, place on the route, or on streets the place
  std::int64_t* previous_action;  ///< B, 3: none
  std::int8_t* allowed;           ///< B x 3, 1: the action may be taken
  std::int64_t* position;         ///< B, place on the route, or on streets the state
  double* reward;                 ///< B, of the action before this observation
  std::uint8_t* flags;            ///< B, FLAG_*
  std::int64_t* frame;            ///< B, place on the route whose frame is seen
};

/// The route of the agents: frames first_frame .. first_frame + frames - 1 of a traversal.
struct Route {
  int first_frame = 0, frames = 2, max_steps = 2;
  bool shuffle = false;  ///< frames are shown in a random order
  int max_detour = 0;    ///< limits an episode to this multiple of its fewest steps too; 0: does not
};

/// The map that agents walk on.
struct Streets {
  std::shared_ptr<const StateMap> states;  ///< null: a line
  std::uint64_t hash = 0;                  ///< of the map
};

/// Several environments on one traversal, each with some agents, that step together. Used by one thread at a time.
class EnvGroup {
 public:
  /// Called about every 50 ms while receive() waits; what it throws ends the wait.
  using Interrupt = std::function<void()>;
  using Seeds = std::vector<std::optional<std::uint64_t>>;
  struct Shape {
    std::string traversal;
    int agents = 0;                   ///< B, of all environments
    std::vector<int> service_agents;  ///< of each environment
    int features = 0;                 ///< D
    int traversal_frames = 0;
    Streets streets = {};
  };

  virtual ~EnvGroup() = default;
  virtual const Shape& shape() const = 0;
  /// Begins anew: environment i gets seeds[i]; one without stays as it is. receive() then gives what agents see.
  virtual void reset(const msg::TaskSettings& settings, const Seeds& seeds) = 0;
  /// Gives each agent its action, B in the order of the batch; kNoAction as Environment::step() allows it.
  virtual void send(std::span<const std::uint8_t> actions) = 0;
  /// Writes the observations that follow. Throws ServiceMissing or ServiceLost; reset() may then begin anew.
  virtual void receive(const Batch& batch, const Interrupt& interrupt) = 0;
};

/// Makes `services` environments in this process. `recording` must outlive them.
std::unique_ptr<EnvGroup> make_local_group(const Recording& recording, int agents, int services);

struct RemoteOptions {
  NodeOptions node;
  std::string traversal;
  int services = 1;
  double wait = 30;  ///< seconds until a missing or silent env_service is an error
};
/// Finds env_services over DDS, in the order of their ids, and drives them as a policy_service does. Releases them at
/// its end. Throws ServiceMissing, and Error.
std::unique_ptr<EnvGroup> make_remote_group(const RemoteOptions& options, const EnvGroup::Interrupt& interrupt);

/// Writes one environment's observation to the rows from `row` on. `features_of(agent)` returns its D numbers.
template <class FeaturesOf>
void write_rows(const msg::Observation& seen, std::uint32_t first_frame, std::size_t dimension, std::size_t row,
                const Batch& batch, FeaturesOf features_of) {
  for (std::size_t agent = 0; agent < seen.goal().size(); ++agent, ++row) {
    std::copy_n(features_of(agent), dimension, batch.features + row * dimension);
    batch.goal[row] = std::int64_t{seen.goal()[agent]} - first_frame;
    batch.position[row] = std::int64_t{seen.position()[agent]} - first_frame;
    const std::uint8_t previous = seen.previous_action()[agent];
    batch.previous_action[row] = previous == kNoAction ? kActions : previous;
    for (int action = 0; action < kActions; ++action)
      batch.allowed[row * kActions + static_cast<std::size_t>(action)] = seen.allowed()[agent] >> action & 1;
    batch.reward[row] = static_cast<double>(seen.reward()[agent]);
    batch.flags[row] = seen.flags()[agent];
    batch.frame[row] = std::int64_t{seen.frame()[agent]} - first_frame;
  }
}

}  // namespace citylearn::python
