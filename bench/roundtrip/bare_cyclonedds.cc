// SPDX-License-Identifier: Apache-2.0
#include <dds/dds.h>

#include <atomic>
#include <cstring>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/roundtrip/bare.h"

namespace roundtrip {
namespace {

dds_entity_t require(dds_entity_t entity) {
  if (entity < 0) throw std::runtime_error(std::string("cyclonedds: ") + dds_strretcode(-entity));
  return entity;
}

// The same network settings as core/dds/middleware_cyclonedds.cc.
const char* const kConfig =
    "<General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize><FragmentSize>64000B</FragmentSize>"
    "</General><Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>47</"
    "MaxAutoParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery><Internal><SocketReceiveBufferSize max=\"4MB\"/>"
    "<SocketSendBufferSize max=\"4MB\"/><Watermarks><WhcHigh>64MB</WhcHigh><WhcHighInit>64MB</WhcHighInit></Watermarks>"
    "</Internal>";

/// The type description that idlc writes for `@final struct NAME { octet bytes[SIZE]; };`
struct Description {
  Description(std::string type, std::size_t size)
      : name(std::move(type)),
        ops{std::uint32_t{DDS_OP_ADR} | std::uint32_t{DDS_OP_TYPE_ARR} | std::uint32_t{DDS_OP_SUBTYPE_1BY}, 0,
            static_cast<std::uint32_t>(size), DDS_OP_RTS},
        descriptor{.m_size = static_cast<std::uint32_t>(size),
                   .m_align = 1,
                   .m_flagset = DDS_TOPIC_FIXED_SIZE | DDS_TOPIC_RESTRICT_DATA_REPRESENTATION,
                   .m_nkeys = 0,
                   .m_typename = name.c_str(),
                   .m_keys = nullptr,
                   .m_nops = 2,
                   .m_ops = ops,
                   .m_meta = "",
                   .type_information = {},
                   .type_mapping = {},
                   .restrict_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1} {}
  Description(const Description&) = delete;
  Description& operator=(const Description&) = delete;
  const std::string name;
  const std::uint32_t ops[4];
  const dds_topic_descriptor_t descriptor;
};

class CyclonePort : public Port {
 public:
  explicit CyclonePort(const PortOptions& options)
      : received_(options.received), question_("Question", options.question), answer_("Answer", options.answer) {
    const Description& written = options.asks ? question_ : answer_;
    const Description& read = options.asks ? answer_ : question_;
    size_ = options.asks ? options.answer : options.question;
    out_.resize(options.asks ? options.question : options.answer);
    in_.resize(size_);
    domain_ = require(dds_create_domain(options.domain, kConfig));
    participant_ = require(dds_create_participant(options.domain, nullptr, nullptr));
    dds_qos_t* qos = dds_create_qos();
    const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
    dds_qset_data_representation(qos, 1, &representation);
    const dds_entity_t write_topic =
        require(dds_create_topic(participant_, &written.descriptor, written.name.c_str(), qos, nullptr));
    const dds_entity_t read_topic =
        require(dds_create_topic(participant_, &read.descriptor, read.name.c_str(), qos, nullptr));
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 16);
    dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, 16, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED);
    writer_ = require(dds_create_writer(participant_, write_topic, qos, nullptr));
    dds_listener_t* listener = dds_create_listener(this);
    if (options.mode == Mode::kListener)
      dds_lset_data_available(listener, [](dds_entity_t, void* self) { static_cast<CyclonePort*>(self)->take(); });
    reader_ = require(dds_create_reader(participant_, read_topic, qos, listener));
    dds_delete_listener(listener);
    dds_delete_qos(qos);
    if (options.mode == Mode::kWaitset) {
      waitset_ = require(dds_create_waitset(participant_));
      require(dds_waitset_attach(waitset_, require(dds_create_readcondition(reader_, DDS_ANY_STATE)), 1));
      thread_ = std::thread([this] {
        dds_attach_t ready[1];
        while (!stop_)
          if (dds_waitset_wait(waitset_, ready, 1, DDS_MSECS(100)) > 0) take();
      });
    }
  }
  ~CyclonePort() override {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    dds_set_listener(reader_, nullptr);
    dds_delete(participant_);
    dds_delete(domain_);
  }
  void send(std::span<const std::byte> sample) override {
    std::memcpy(out_.data(), sample.data(), out_.size());
    dds_write(writer_, out_.data());
  }

 private:
  void take() {
    void* samples[1] = {in_.data()};
    dds_sample_info_t info;
    while (dds_take(reader_, samples, &info, 1, 1) == 1)
      if (info.valid_data) received_({static_cast<const std::byte*>(samples[0]), size_});
  }

  const std::function<void(std::span<const std::byte>)> received_;
  const Description question_, answer_;
  std::size_t size_;
  std::vector<std::byte> out_, in_;
  dds_entity_t domain_, participant_, writer_, reader_, waitset_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace

std::unique_ptr<Port> open_cyclonedds(const PortOptions& options) { return std::make_unique<CyclonePort>(options); }

}  // namespace roundtrip
