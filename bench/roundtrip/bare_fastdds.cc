// SPDX-License-Identifier: Apache-2.0
#include <atomic>
#include <fastdds/dds/core/condition/WaitSet.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <stdexcept>
#include <thread>
#include <vector>

#include "bench/roundtrip/bare.h"
#include "core/dds/middleware_fastdds_type.h"

namespace roundtrip {
namespace {

using namespace eprosima::fastdds::dds;  // NOLINT
using citylearn::fast::Duration;
using citylearn::fast::Raw;
using citylearn::fast::RawType;
using citylearn::fast::rtps::InstanceHandle_t;
using citylearn::fast::rtps::IPLocator;
using citylearn::fast::rtps::Locator_t;

template <class Pointer>
Pointer require(Pointer pointer) {
  if (!pointer) throw std::runtime_error("fastdds cannot create an entity");
  return pointer;
}

class FastPort : public Port, private DataReaderListener {
 public:
  explicit FastPort(const PortOptions& options) : received_(options.received) {
    // The same network settings as core/dds/middleware_fastdds.cc.
    DomainParticipantQos qos;
    auto udp = std::make_shared<citylearn::fast::transport::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList = {"127.0.0.1"};
    udp->maxInitialPeersRange = 48;
    udp->maxMessageSize = 65500;
    udp->sendBufferSize = udp->receiveBufferSize = 4 << 20;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports = {udp};
    Locator_t loopback;
    IPLocator::createLocator(LOCATOR_KIND_UDPv4, "127.0.0.1", 0, loopback);
    qos.wire_protocol().builtin.metatrafficUnicastLocatorList.push_back(loopback);
    qos.wire_protocol().builtin.initialPeersList.push_back(loopback);
    qos.wire_protocol().builtin.discovery_config.leaseDuration_announcementperiod = Duration(1, 0u);
    qos.wire_protocol().builtin.discovery_config.leaseDuration = Duration(10, 0u);
    participant_ = require(DomainParticipantFactory::get_instance()->create_participant(options.domain, qos));

    const char* const names[2] = {"Question", "Answer"};
    const std::size_t sizes[2] = {options.question, options.answer};
    const int writes = options.asks ? 0 : 1, reads = 1 - writes;
    for (int i : {0, 1}) participant_->register_type(TypeSupport(new RawType(names[i], sizes[i], true)));
    write_topic_ = require(participant_->create_topic(names[writes], names[writes], TOPIC_QOS_DEFAULT));
    read_topic_ = require(participant_->create_topic(names[reads], names[reads], TOPIC_QOS_DEFAULT));

    publisher_ = require(participant_->create_publisher(PUBLISHER_QOS_DEFAULT));
    subscriber_ = require(participant_->create_subscriber(SUBSCRIBER_QOS_DEFAULT));
    DataWriterQos writer;
    writer.reliability().kind = RELIABLE_RELIABILITY_QOS;
    writer.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    writer.history().kind = KEEP_LAST_HISTORY_QOS;
    writer.history().depth = 16;
    writer.data_sharing().off();
    citylearn::fast::repair_at_once(writer, 10'000'000u);
    writer.reliable_writer_qos().disable_heartbeat_piggyback = true;
    writer_ = require(publisher_->create_datawriter(write_topic_, writer));
    DataReaderQos reader;
    reader.reliability().kind = RELIABLE_RELIABILITY_QOS;
    reader.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    reader.history().kind = KEEP_LAST_HISTORY_QOS;
    reader.history().depth = 16;
    reader.data_sharing().off();
    citylearn::fast::repair_at_once(reader);
    if (options.mode == Mode::kListener) {
      reader_ = require(subscriber_->create_datareader(read_topic_, reader, this, StatusMask::data_available()));
      return;
    }
    reader_ = require(subscriber_->create_datareader(read_topic_, reader));
    reader_->get_statuscondition().set_enabled_statuses(StatusMask::data_available());
    waitset_.attach_condition(reader_->get_statuscondition());
    thread_ = std::thread([this] {
      ConditionSeq ready;
      while (!stop_)
        if (citylearn::fast::is_ok(waitset_.wait(ready, Duration(0, 100'000'000u)))) take();
    });
  }
  ~FastPort() override {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    reader_->set_listener(nullptr);
    subscriber_->delete_datareader(reader_);
    publisher_->delete_datawriter(writer_);
    participant_->delete_subscriber(subscriber_);
    participant_->delete_publisher(publisher_);
    participant_->delete_topic(write_topic_);
    participant_->delete_topic(read_topic_);
    DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  void send(std::span<const std::byte> sample) override {
    Raw raw{sample};
    writer_->write(&raw, InstanceHandle_t());
  }

 private:
  void on_data_available(DataReader*) override { take(); }
  void take() {
    Raw raw{{}, &in_};
    SampleInfo info;
    while (citylearn::fast::is_ok(reader_->take_next_sample(&raw, &info)))
      if (info.valid_data) received_(in_);
  }

  const std::function<void(std::span<const std::byte>)> received_;
  std::vector<std::byte> in_;
  DomainParticipant* participant_;
  Topic *write_topic_, *read_topic_;
  Publisher* publisher_;
  Subscriber* subscriber_;
  DataWriter* writer_;
  DataReader* reader_;
  WaitSet waitset_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace

std::unique_ptr<Port> open_fastdds(const PortOptions& options) { return std::make_unique<FastPort>(options); }

}  // namespace roundtrip
