// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/service_monitor.h"

namespace citylearn {

void ServiceMonitor::on_status(const msg::ServiceStatus& status) {
  const Clock::time_point now = Clock::now();
  const std::string id = status.header().sender().c_str(), service = status.service().c_str();
  if (const auto found = unencoded_.find(id); found != unencoded_.end()) found->second.presence.heard(now);
  if (service != "policy_service" && service != "encoder_service") return;
  const std::uint64_t incarnation = status.header().incarnation();
  const bool failed = status.service_state() == msg::FAILED && service == "policy_service";  // others go on
  if (status.service_state() == msg::STOPPING || failed) {
    services_.erase(incarnation);
    return;
  }
  if (services_.size() >= kMaxServices)
    std::erase_if(services_, [now](const auto& entry) { return !entry.second.presence.here(now); });
  if (services_.size() < kMaxServices || services_.contains(incarnation))
    services_[incarnation] = {id, service, status.activity().c_str(),
                              status.service_state() == msg::RUNNING || status.service_state() == msg::STARTING,
                              Presence(now)};
}

std::string ServiceMonitor::id_of(std::uint64_t incarnation) const {
  const auto found = services_.find(incarnation);
  return found != services_.end() && found->second.presence.here(Clock::now()) ? found->second.id : "";
}

std::vector<ServiceMonitor::Service> ServiceMonitor::encoders() const {
  std::vector<Service> found;
  for (const auto& [incarnation, service] : services_)
    if (service.service == "encoder_service" && service.presence.here(Clock::now())) found.push_back(service);
  return found;
}

std::map<std::string, std::string> ServiceMonitor::unencoded() const {
  std::map<std::string, std::string> found;
  for (const auto& [id, images] : unencoded_)
    if (images.presence.here(Clock::now())) found[id] = images.traversal;
  return found;
}

}  // namespace citylearn
