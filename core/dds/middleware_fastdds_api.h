// SPDX-License-Identifier: Apache-2.0
#pragma once

// What releases 2.9 and 3 of Fast DDS name or shape differently, so that nothing else asks which one it is built with.

#if __has_include(<fastrtps/utils/IPLocator.h>)
#define CITYLEARN_FASTDDS_RELEASE 2
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#else
#define CITYLEARN_FASTDDS_RELEASE 3
#include <fastdds/dds/core/ReturnCode.hpp>
#include <fastdds/rtps/transport/ChainingTransport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/utils/IPLocator.hpp>
#endif

#include <cstdint>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

namespace citylearn::fast {

namespace dds = eprosima::fastdds::dds;
namespace transport = eprosima::fastdds::rtps;
#if CITYLEARN_FASTDDS_RELEASE == 2
namespace rtps = eprosima::fastrtps::rtps;
using Duration = eprosima::fastrtps::Duration_t;
using ReturnCode = eprosima::fastrtps::types::ReturnCode_t;
inline bool is_ok(ReturnCode code) { return code == ReturnCode::RETCODE_OK; }
inline bool is_timeout(ReturnCode code) { return code == ReturnCode::RETCODE_TIMEOUT; }
inline std::uint32_t number_of(ReturnCode code) { return code(); }
#else
namespace rtps = eprosima::fastdds::rtps;
using Duration = dds::Duration_t;
using ReturnCode = dds::ReturnCode_t;
inline bool is_ok(ReturnCode code) { return code == dds::RETCODE_OK; }
inline bool is_timeout(ReturnCode code) { return code == dds::RETCODE_TIMEOUT; }
inline std::int32_t number_of(ReturnCode code) { return code; }
#endif

/// Makes a writer send heartbeats with this period (ns) and repair losses at once: with the defaults (3 s heartbeats,
/// 5 ms answers) each lost packet costs that much.
inline void repair_at_once(dds::DataWriterQos& qos, std::uint32_t heartbeat) {
  auto& times = qos.reliable_writer_qos().times;
#if CITYLEARN_FASTDDS_RELEASE == 2
  times.heartbeatPeriod = Duration(0, heartbeat);
  times.initialHeartbeatDelay = times.nackResponseDelay = times.nackSupressionDuration = Duration(0, 0u);
#else
  times.heartbeat_period = Duration(0, heartbeat);
  times.initial_heartbeat_delay = times.nack_response_delay = times.nack_supression_duration = Duration(0, 0u);
#endif
}
/// Makes a reader ask for what it lacks at once.
inline void repair_at_once(dds::DataReaderQos& qos) {
  auto& times = qos.reliable_reader_qos().times;
#if CITYLEARN_FASTDDS_RELEASE == 2
  times.initialAcknackDelay = times.heartbeatResponseDelay = Duration(0, 0u);
#else
  times.initial_acknack_delay = times.heartbeat_response_delay = Duration(0, 0u);
#endif
}

}  // namespace citylearn::fast
