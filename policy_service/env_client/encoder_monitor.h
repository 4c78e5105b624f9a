// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "core/exchange/presence.h"
#include "core/wire/node.h"

namespace citylearn {

/// Keeps track of the encoder_services that report their status, and of the env_services whose images none of them has
/// completed yet. Used by one thread.
class EncoderMonitor {
 public:
  void on_status(const msg::ServiceStatus& status);
  /// Notes that an env_service announced images without features.
  void on_images(const msg::TraversalInfo& info);
  /// Notes that an env_service's announcement is complete.
  void on_complete(const msg::Header& env) { unencoded_.erase(env.sender().c_str()); }

  /// Returns the traversals that wait for an encoder_service, by the id of their env_service.
  std::map<std::string, std::string> unencoded() const;
  struct Encoder {
    std::string status;  ///< "encoder: summer: 120 of 3576 frames encoded"
    bool working;
  };
  std::vector<Encoder> encoders() const;
  /// Returns whether this incarnation of an encoder_service was heard lately.
  bool alive(std::uint64_t incarnation) const;

 private:
  template <class Value>
  struct Dated {
    Value value;
    Presence presence;
  };
  std::map<std::string, Dated<std::string>> unencoded_;  ///< traversal, by id of the env_service
  std::map<std::string, Dated<Encoder>> encoders_;       ///< by id
  std::map<std::uint64_t, Presence> incarnations_;
};

}  // namespace citylearn
