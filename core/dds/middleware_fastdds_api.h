// SPDX-License-Identifier: Apache-2.0
#pragma once

// What releases 2.9 and 3 of Fast DDS name or shape differently, so that nothing else asks which one it is built with.

#if __has_include(<fastrtps/utils/IPLocator.h>)
#define CITYLEARN_FASTDDS_RELEASE 2
#include <fastdds/rtps/common/WriteParams.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#else
#define CITYLEARN_FASTDDS_RELEASE 3
#include <fastdds/dds/core/ReturnCode.hpp>
#include <fastdds/rtps/common/WriteParams.hpp>
#include <fastdds/rtps/transport/ChainingTransport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/utils/IPLocator.hpp>
#endif

#include <algorithm>
#include <cstdint>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

#include "core/dds/discovery_monitor.h"

namespace citylearn::fast {

namespace dds = eprosima::fastdds::dds;
namespace transport = eprosima::fastdds::rtps;
#if CITYLEARN_FASTDDS_RELEASE == 2
namespace rtps = eprosima::fastrtps::rtps;
using Duration = eprosima::fastrtps::Duration_t;
using ReturnCode = eprosima::fastrtps::types::ReturnCode_t;
inline bool is_ok(ReturnCode code) { return code == ReturnCode::RETCODE_OK; }
inline bool is_lost(ReturnCode code) {
  return code == ReturnCode::RETCODE_TIMEOUT || code == ReturnCode::RETCODE_OUT_OF_RESOURCES;
}
inline std::uint32_t number_of(ReturnCode code) { return code(); }
#else
namespace rtps = eprosima::fastdds::rtps;
using Duration = dds::Duration_t;
using ReturnCode = dds::ReturnCode_t;
inline bool is_ok(ReturnCode code) { return code == dds::RETCODE_OK; }
inline bool is_lost(ReturnCode code) { return code == dds::RETCODE_TIMEOUT || code == dds::RETCODE_OUT_OF_RESOURCES; }
inline std::int32_t number_of(ReturnCode code) { return code; }
#endif

/// Makes a writer send heartbeats with this period (ns) and repair losses at once: with the defaults (3 s heartbeats,
/// 5 ms answers) each lost packet costs that much. After a sample a request for it is ignored for up to a quarter of
/// the period. If it were for no time, a thread of Fast DDS would be woken for each sample, to end that time.
inline void repair_at_once(dds::DataWriterQos& qos, std::uint32_t heartbeat) {
  auto& times = qos.reliable_writer_qos().times;
#if CITYLEARN_FASTDDS_RELEASE == 2
  times.heartbeatPeriod = Duration(0, heartbeat);
  times.initialHeartbeatDelay = times.nackResponseDelay = Duration(0, 0u);
  times.nackSupressionDuration = Duration(0, heartbeat / 4);
#else
  times.heartbeat_period = Duration(0, heartbeat);
  times.initial_heartbeat_delay = times.nack_response_delay = Duration(0, 0u);
  times.nack_supression_duration = Duration(0, heartbeat / 4);
#endif
}
/// Makes a reader ask for what it lacks at once. Until a writer's first heartbeat it asks with a period that must not
/// be 0, because a writer that was killed stays matched for its lease of 10 s.
inline void repair_at_once(dds::DataReaderQos& qos) {
  auto& times = qos.reliable_reader_qos().times;
#if CITYLEARN_FASTDDS_RELEASE == 2
  times.initialAcknackDelay = Duration(0, 10'000'000u);
  times.heartbeatResponseDelay = Duration(0, 0u);
#else
  times.initial_acknack_delay = Duration(0, 10'000'000u);
  times.heartbeat_response_delay = Duration(0, 0u);
#endif
}

/// Returns the policies of another participant's writer or reader.
inline EndpointQos qos_of(const dds::ReliabilityQosPolicy& reliability, const dds::DurabilityQosPolicy& durability,
                          const dds::OwnershipQosPolicy& ownership, const dds::LivelinessQosPolicy& liveliness,
                          const dds::DeadlineQosPolicy& deadline, const dds::PartitionQosPolicy& partition,
                          const dds::DataRepresentationQosPolicy& representation, rtps::TopicKind_t topic_kind) {
  const auto& encodings = representation.m_value;
  const auto xcdr1 = std::find(encodings.begin(), encodings.end(), dds::XCDR_DATA_REPRESENTATION);
  // Kinds come over the wire as they are.
  return {reliability.kind == dds::RELIABLE_RELIABILITY_QOS,
          std::clamp(static_cast<int>(durability.kind), 0, 3),
          ownership.kind == dds::EXCLUSIVE_OWNERSHIP_QOS,
          std::clamp(static_cast<int>(liveliness.kind), 0, 2),
          static_cast<double>(liveliness.lease_duration.to_ns()) / 1e9,
          static_cast<double>(deadline.period.to_ns()) / 1e9,
          partition.empty() ? "" : partition.begin()->name(),
          encodings.empty() || xcdr1 != encodings.end(),
          topic_kind == rtps::WITH_KEY};
}
template <class Info>
EndpointQos qos_of(const Info& info) {
#if CITYLEARN_FASTDDS_RELEASE == 2
  const auto& qos = info.m_qos;
  return qos_of(qos.m_reliability, qos.m_durability, qos.m_ownership, qos.m_liveliness, qos.m_deadline, qos.m_partition,
                qos.representation, info.topicKind());
#else
  return qos_of(info.reliability, info.durability, info.ownership, info.liveliness, info.deadline, info.partition,
                info.representation, info.topic_kind);
#endif
}

}  // namespace citylearn::fast
