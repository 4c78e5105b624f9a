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
    const auto& qos = info.m_qos;
    const EndpointQos about = qos_of(qos.m_reliability, qos.m_durability, qos.m_ownership, qos.m_liveliness,
                                     qos.m_deadline, qos.m_partition, qos.representation, info.topicKind());
#else
    const auto& guid = info.guid;
    const auto &topic = info.topic_name, &type = info.type_name;
    const EndpointQos about = qos_of(info.reliability, info.durability, info.ownership, info.liveliness, info.deadline,
                                     info.partition, info.representation, info.topic_kind);
#endif
    if (lost) discovery_.endpoint_lost(text_of(guid));
    if (found)
      discovery_.endpoint_found(text_of(guid), text_of(guid.guidPrefix), writes, topic.to_string(), type.to_string(),
                                about);
  }

  static EndpointQos qos_of(
      const fast::dds::ReliabilityQosPolicy& reliability, const fast::dds::DurabilityQosPolicy& durability,
      const fast::dds::OwnershipQosPolicy& ownership, const fast::dds::LivelinessQosPolicy& liveliness,
      const fast::dds::DeadlineQosPolicy& deadline, const fast::dds::PartitionQosPolicy& partition,
      const fast::dds::DataRepresentationQosPolicy& representation, fast::rtps::TopicKind_t topic_kind) {
    const auto& encodings = representation.m_value;
    const auto xcdr1 = std::find(encodings.begin(), encodings.end(), fast::dds::XCDR_DATA_REPRESENTATION);
    // Kinds come over the wire as they are.
    return {reliability.kind == fast::dds::RELIABLE_RELIABILITY_QOS,
            std::clamp(static_cast<int>(durability.kind), 0, 3),
            ownership.kind == fast::dds::EXCLUSIVE_OWNERSHIP_QOS,
            std::clamp(static_cast<int>(liveliness.kind), 0, 2),
            static_cast<double>(liveliness.lease_duration.to_ns()) / 1e9,
            static_cast<double>(deadline.period.to_ns()) / 1e9,
            partition.empty() ? "" : partition.begin()->name(),
            encodings.empty() || xcdr1 != encodings.end(),
            topic_kind == fast::rtps::WITH_KEY};
  }

  template <class Guid>
  static std::string text_of(const Guid& guid) {
    return (std::ostringstream() << guid).str();
  }

  DiscoveryMonitor& discovery_;
};

}  // namespace citylearn::internal
