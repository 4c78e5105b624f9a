// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/encoder_monitor.h"

namespace citylearn {

void EncoderMonitor::on_status(const msg::ServiceStatus& status) {
  const std::string id = status.header().sender().c_str();
  if (const auto found = unencoded_.find(id); found != unencoded_.end()) found->second.presence.heard(Clock::now());
  if (std::string(status.service().c_str()) != "encoder_service") return;
  incarnations_[status.header().incarnation()].heard(Clock::now());
  encoders_[id] = {{id + ": " + status.activity().c_str(), status.service_state() == msg::RUNNING},
                   Presence(Clock::now())};
}

void EncoderMonitor::on_images(const msg::TraversalInfo& info) {
  unencoded_[info.header().sender().c_str()] = {info.traversal().c_str(), Presence(Clock::now())};
}

std::map<std::string, std::string> EncoderMonitor::unencoded() const {
  std::map<std::string, std::string> found;
  for (const auto& [id, traversal] : unencoded_)
    if (traversal.presence.here(Clock::now())) found[id] = traversal.value;
  return found;
}

std::vector<EncoderMonitor::Encoder> EncoderMonitor::encoders() const {
  std::vector<Encoder> found;
  for (const auto& [id, encoder] : encoders_)
    if (encoder.presence.here(Clock::now())) found.push_back(encoder.value);
  return found;
}

bool EncoderMonitor::alive(std::uint64_t incarnation) const {
  const auto heard = incarnations_.find(incarnation);
  return heard != incarnations_.end() && heard->second.here(Clock::now());
}

}  // namespace citylearn
