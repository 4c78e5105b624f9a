// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>

#include "core/wire/incumbent.h"
#include "core/wire/node.h"

namespace citylearn {

/// Knows the other actors of the run and which env_services they serve, and divides the env_services among all. Used by
/// one thread.
class OtherActors {
 public:
  explicit OtherActors(const Node& node) : node_(node) {}

  /// Takes in a status.
  void on_status(const msg::ActorStatus& status);
  /// Forgets the actors that are gone.
  void forget_gone();
  /// Returns the id of the actor that serves this incarnation of an env_service, or null.
  const std::string* serving(std::uint64_t env_incarnation) const;

  struct Share {
    std::size_t count;   ///< env_services that this actor should serve
    std::size_t before;  ///< number of actors with a smaller id
  };
  /// Returns this actor's share: `envs` divided by the actors, and the first actors by id one more while some are left.
  Share share_of(std::size_t envs) const;

 private:
  struct Actor {
    Incumbent presence;
    std::set<std::uint64_t> environments;
  };
  const Node& node_;
  std::map<std::string, Actor> actors_;
};

}  // namespace citylearn
