// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <sstream>
#include <string>

#include "core/dds/discovery_monitor.h"
#include "core/dds/middleware_fastdds_api.h"
#include "core/dds/middleware_internal.h"

namespace citylearn::internal {

/// Passes what Fast DDS discovers to a DiscoveryMonitor. Called by Fast's threads.
class FastListener : public fast::dds::DomainParticipantListener {
 public:
  explicit FastListener(DiscoveryMonitor& discovery) : discovery_(discovery) {}
  /// Called when another participant was discovered.
  virtual void participant_found() = 0;

#if CITYLEARN_FASTDDS_RELEASE == 2
  void on_participant_discovery(fast::dds::DomainParticipant*, fast::rtps::ParticipantDiscoveryInfo&& info) override {
    const auto& about = info.info;
    participant(about.m_guid, about.m_participantName.to_string(), about.m_VendorId, about,
                info.status == info.DISCOVERED_PARTICIPANT, info.status == info.CHANGED_QOS_PARTICIPANT);
  }
  void on_publisher_discovery(fast::dds::DomainParticipant*, fast::rtps::WriterDiscoveryInfo&& info) override {
    endpoint(info.info, true, info.status == info.DISCOVERED_WRITER, info.status == info.REMOVED_WRITER);
  }
  void on_subscriber_discovery(fast::dds::DomainParticipant*, fast::rtps::ReaderDiscoveryInfo&& info) override {
    endpoint(info.info, false, info.status == info.DISCOVERED_READER, info.status == info.REMOVED_READER);
  }
#else
  void on_participant_discovery(fast::dds::DomainParticipant*, fast::rtps::ParticipantDiscoveryStatus status,
                                const fast::dds::ParticipantBuiltinTopicData& info, bool&) override {
    using Status = fast::rtps::ParticipantDiscoveryStatus;
    participant(info.guid, info.participant_name.to_string(), info.vendor_id, info,
                status == Status::DISCOVERED_PARTICIPANT, status == Status::CHANGED_QOS_PARTICIPANT);
  }
  void on_data_writer_discovery(fast::dds::DomainParticipant*, fast::rtps::WriterDiscoveryStatus status,
                                const fast::dds::PublicationBuiltinTopicData& info, bool&) override {
    using Status = fast::rtps::WriterDiscoveryStatus;
    endpoint(info, true, status == Status::DISCOVERED_WRITER, status == Status::REMOVED_WRITER);
  }
  void on_data_reader_discovery(fast::dds::DomainParticipant*, fast::rtps::ReaderDiscoveryStatus status,
                                const fast::dds::SubscriptionBuiltinTopicData& info, bool&) override {
    using Status = fast::rtps::ReaderDiscoveryStatus;
    endpoint(info, false, status == Status::DISCOVERED_READER, status == Status::REMOVED_READER);
  }
  /// Release 3 tells of participants once it trusts them, and of others nothing but their number.
  void onParticipantAuthentication(fast::dds::DomainParticipant*,
                                   fast::rtps::ParticipantAuthenticationInfo&& info) override {
    const std::string number = text_of(info.guid.guidPrefix);
    if (info.status == info.UNAUTHORIZED_PARTICIPANT) discovery_.identity_refused(number, {number, "", {}});
  }
#endif

 private:
  template <class Vendor, class Addresses>
  void participant(const fast::rtps::GUID_t& guid, const std::string& name, const Vendor& vendor,
                   const Addresses& locators, bool found, bool changed) {
    const std::string key = text_of(guid.guidPrefix);
    if (!found && !changed) discovery_.participant_lost(key);
    if (!found) return;
    participant_found();
    DiscoveryMonitor::Participant participant{name, vendor_name(vendor[0], vendor[1]), {}};
    for (const auto* list : {&locators.metatraffic_locators, &locators.default_locators})
      for (const fast::rtps::Locator_t& each : list->unicast) {
        if (each.kind != LOCATOR_KIND_UDPv4) continue;
        const std::string address = fast::rtps::IPLocator::toIPv4string(each);
        auto& known = participant.addresses;
        if (std::find(known.begin(), known.end(), address) == known.end()) known.push_back(address);
      }
    discovery_.participant_found(key, participant);
  }

  template <class Info>
  void endpoint(const Info& info, bool writes, bool found, bool lost) {
#if CITYLEARN_FASTDDS_RELEASE == 2
    const auto& guid = info.guid();
    const auto &topic = info.topicName(), &type = info.typeName();
#else
    const auto& guid = info.guid;
    const auto &topic = info.topic_name, &type = info.type_name;
#endif
    if (lost) discovery_.endpoint_lost(text_of(guid));
    if (found)
      discovery_.endpoint_found(text_of(guid), text_of(guid.guidPrefix), writes, topic.to_string(), type.to_string(),
                                fast::qos_of(info));
  }

  template <class Guid>
  static std::string text_of(const Guid& guid) {
    return (std::ostringstream() << guid).str();
  }

  DiscoveryMonitor& discovery_;
};

}  // namespace citylearn::internal
