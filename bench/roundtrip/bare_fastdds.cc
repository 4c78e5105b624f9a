// SPDX-License-Identifier: Apache-2.0
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <atomic>
#include <cstring>
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
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <stdexcept>
#include <thread>
#include <vector>

#include "bench/roundtrip/bare.h"

namespace roundtrip {
namespace {

using namespace eprosima::fastdds::dds;  // NOLINT
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::types::ReturnCode_t;

/// A structure with one array of octets: encapsulation, then the octets.
class ArrayType : public TopicDataType {
 public:
  ArrayType(const char* name, std::size_t size) : size_(static_cast<std::uint32_t>(size)) {
    setName(name);
    m_typeSize = size_ + 4 + 3;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const unsigned char encapsulation[4] = {0, 1, 0, 0};
    std::memcpy(payload->data, encapsulation, 4);
    std::memcpy(payload->data + 4, data, size_);
    payload->length = size_ + 4;
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    if (payload->length < size_ + 4) return false;
    std::memcpy(data, payload->data + 4, size_);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void*) override {
    return [this] { return size_ + 4; };
  }
  void* createData() override { return new unsigned char[size_]; }
  void deleteData(void* data) override { delete[] static_cast<unsigned char*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }

 private:
  const std::uint32_t size_;
};

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
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
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
    qos.wire_protocol().builtin.discovery_config.leaseDuration_announcementperiod = Duration_t(1, 0u);
    qos.wire_protocol().builtin.discovery_config.leaseDuration = Duration_t(10, 0u);
    participant_ = require(DomainParticipantFactory::get_instance()->create_participant(options.domain, qos));

    const char* const names[2] = {"Question", "Answer"};
    const std::size_t sizes[2] = {options.question, options.answer};
    const int writes = options.asks ? 0 : 1, reads = 1 - writes;
    for (int i : {0, 1}) participant_->register_type(TypeSupport(new ArrayType(names[i], sizes[i])));
    write_topic_ = require(participant_->create_topic(names[writes], names[writes], TOPIC_QOS_DEFAULT));
    read_topic_ = require(participant_->create_topic(names[reads], names[reads], TOPIC_QOS_DEFAULT));
    in_.resize(sizes[reads]);

    publisher_ = require(participant_->create_publisher(PUBLISHER_QOS_DEFAULT));
    subscriber_ = require(participant_->create_subscriber(SUBSCRIBER_QOS_DEFAULT));
    DataWriterQos writer;
    writer.reliability().kind = RELIABLE_RELIABILITY_QOS;
    writer.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    writer.history().kind = KEEP_LAST_HISTORY_QOS;
    writer.history().depth = 16;
    writer.data_sharing().off();
    writer.reliable_writer_qos().times.initialHeartbeatDelay = Duration_t(0, 0u);
    writer.reliable_writer_qos().times.heartbeatPeriod = Duration_t(0, 10'000'000u);
    writer.reliable_writer_qos().times.nackResponseDelay = Duration_t(0, 0u);
    writer.reliable_writer_qos().times.nackSupressionDuration = Duration_t(0, 0u);
    writer.reliable_writer_qos().disable_heartbeat_piggyback = true;
    writer_ = require(publisher_->create_datawriter(write_topic_, writer));
    DataReaderQos reader;
    reader.reliability().kind = RELIABLE_RELIABILITY_QOS;
    reader.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    reader.history().kind = KEEP_LAST_HISTORY_QOS;
    reader.history().depth = 16;
    reader.data_sharing().off();
    reader.reliable_reader_qos().times.initialAcknackDelay = Duration_t(0, 0u);
    reader.reliable_reader_qos().times.heartbeatResponseDelay = Duration_t(0, 0u);
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
        if (waitset_.wait(ready, Duration_t(0, 100'000'000u)) == ReturnCode_t::RETCODE_OK) take();
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
    writer_->write(const_cast<std::byte*>(sample.data()), InstanceHandle_t());
  }

 private:
  void on_data_available(DataReader*) override { take(); }
  void take() {
    SampleInfo info;
    while (reader_->take_next_sample(in_.data(), &info) == ReturnCode_t::RETCODE_OK)
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
