// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <dds/ddsi/ddsi_xqos.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstring>

#include "core/dds/middleware_cyclonedds_remote.h"
#include "core/dds/middleware_cyclonedds_sample.h"
#include "core/dds/middleware_internal.h"
#include "core/dds/security.h"
#include "core/dds/wakeup.h"
#include "core/util/error.h"

namespace citylearn::internal {
namespace {

using QosOwner = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;
using ListenerOwner = std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)>;

QosOwner make_qos() { return {dds_create_qos(), dds_delete_qos}; }

/// Returns the entity, or throws Error.
dds_entity_t require(dds_entity_t entity, const std::string& what, const std::string& where) {
  if (entity < 0) throw Error("cyclonedds cannot " + what + ": " + dds_strretcode(-entity), where);
  return entity;
}

// One domain per process and number.

std::mutex log_mutex;
std::string last_complaint;

void forward_log(void*, const dds_log_data_t* data) {
  std::string line(data->message, data->size);
  while (!line.empty() && line.back() == '\n') line.pop_back();
  if (const auto told = explain_security(line))
    log_security_event(*told);
  else
    spdlog::debug("cyclonedds: {}", line);
  std::lock_guard lock(log_mutex);
  last_complaint = line;
}

/// The most bytes that headers around a fragment take in a message.
constexpr int kFragmentHeaders = 128;

/// Lets hosts that were cut off find each other again within a second: Cyclone's default is 0.8 of its lease of 10 s.
const char* const kDiscoveryInterval = "<SPDPInterval>1s</SPDPInterval>";

/// Packets get lost between hosts. A reader notices at the writer's next heartbeat, and a step waits for that. With the
/// defaults (a heartbeat after 100 ms, as long until the request) each lost packet costs 200 ms.
const char* const kRepairIntervals =
    "<HeartbeatInterval min=\"1ms\" minsched=\"1ms\" max=\"1s\">1ms</HeartbeatInterval><NackDelay>0s</NackDelay>"
    "<AckDelay>0s</AckDelay>";

/// On loopback only messages that reach a participant before it knows their sender are lost, as the first ones about
/// readers and writers are. With the defaults a service that starts waits 100 ms for each of them.
const char* const kLoopbackRepairIntervals =
    "<HeartbeatInterval min=\"5ms\" minsched=\"5ms\" max=\"1s\">5ms</HeartbeatInterval><NackDelay>0s</NackDelay>";

/// Tells others which endpoint was deleted: Fast DDS finds it by this hash alone.
const char* const kDeletedKeyhash = "<GenerateKeyhash>true</GenerateKeyhash>";

std::string config_of(const Network& network) {
  std::string interfaces, peers;
  for (const std::string& address : network.addresses)
    interfaces += "<NetworkInterface address=\"" + address + "\" multicast=\"false\"/>";
  for (const Network::Peer& peer : network.peers)
    peers += "<Peer address=\"" + peer.address + (peer.port ? ":" + std::to_string(peer.port) : "") + "\"/>";
  const std::string index = "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>" +
                            std::to_string(kParticipants - 1) + "</MaxAutoParticipantIndex>";
  // Cyclone DDS does not multicast on loopback, so where there is nothing else it asks this host.
  if (network.multicast)
    return "<Discovery>" + index + "<Peers><Peer address=\"localhost\"/>" + peers + "</Peers></Discovery><Internal>" +
           kDeletedKeyhash + "</Internal>";
  const int fragment = network.loopback_only ? 64000 : network.datagram - kFragmentHeaders;
  // A smaller send buffer than asked for is not a failure, so only the upper bound of the socket buffers is set. The
  // watermarks are above what the deepest history holds: a writer never waits for a reader.
  return "<General><Interfaces>" + interfaces + "</Interfaces><AllowMulticast>false</AllowMulticast><MaxMessageSize>" +
         std::to_string(network.datagram) + "B</MaxMessageSize><FragmentSize>" + std::to_string(fragment) +
         "B</FragmentSize></General>"
         "<Discovery>" +
         index + "<Peers>" + peers + "</Peers>" + (network.loopback_only ? "" : kDiscoveryInterval) +
         "</Discovery><Internal><SocketReceiveBufferSize max=\"4MB\"/><SocketSendBufferSize max=\"4MB\"/>" +
         kDeletedKeyhash + (network.loopback_only ? kLoopbackRepairIntervals : kRepairIntervals) +
         "<Watermarks><WhcHigh>64MB</WhcHigh><WhcHighInit>64MB</WhcHighInit></Watermarks></Internal>";
}

class Domain {
 public:
  static std::shared_ptr<Domain> of(const Network& network) {
    static std::mutex mutex;
    static std::map<std::uint32_t, std::weak_ptr<Domain>> domains;
    std::lock_guard lock(mutex);
    const std::string config = config_of(network);
    std::shared_ptr<Domain> domain = domains[network.domain].lock();
    if (domain && domain->config_ != config)
      throw Error(
          "this process already uses domain " + std::to_string(network.domain) + " with other interfaces or peers",
          "cyclonedds");
    if (!domain) domains[network.domain] = domain = std::make_shared<Domain>(network, config);
    return domain;
  }
  Domain(const Network& network, const std::string& config) : config_(config) {
    dds_set_log_sink(forward_log, nullptr);
    dds_set_trace_sink(forward_log, nullptr);
    {
      std::lock_guard lock(log_mutex);
      last_complaint.clear();
    }
    domain_ = dds_create_domain(network.domain, config.c_str());
    if (domain_ >= 0) return;
    free_index(network);  // has a clearer word when that is what is wrong
    std::lock_guard lock(log_mutex);
    throw Error("cannot start in domain " + std::to_string(network.domain) + " on " + network.interfaces + ": " +
                    (last_complaint.empty() ? dds_strretcode(-domain_) : last_complaint),
                "cyclonedds");
  }
  ~Domain() { dds_delete(domain_); }

 private:
  const std::string config_;
  dds_entity_t domain_;
};

Guid guid_of(dds_entity_t entity) {
  dds_guid_t guid;
  require(dds_get_guid(entity, &guid), "name an entity", "cyclonedds");
  return std::to_array(guid.v);
}

QosOwner endpoint_qos(const Topic& topic, bool writer) {
  const Profile profile = topic.profile;
  QosOwner qos = make_qos();
  const Depth depth = depth_of(profile);
  const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &representation);
  if (!topic.user_data.empty()) dds_qset_userdata(qos.get(), topic.user_data.data(), topic.user_data.size());
  const bool repeats = writer || profile != Profile::kRos2;
  dds_qset_reliability(qos.get(), repeats ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       std::chrono::nanoseconds(kBlocking).count());
  dds_qset_durability(qos.get(), is_kept(profile) ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, writer ? depth.writer : depth.reader);
  if (writer) {
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, depth.writer, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
    dds_qset_writer_data_lifecycle(qos.get(), false);  // a leaving writer does not dispose what others write
  }
  return qos;
}

/// A topic entity of one writer or reader. Cyclone shares what those of one name have in common.
class CycloneTopic {
 public:
  CycloneTopic(dds_entity_t participant, const Topic& topic) {
    const QosOwner qos = make_qos();
    const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
    dds_qset_data_representation(qos.get(), 1, &representation);
    ddsi_sertype* type = make_type(topic.type);
    // Gives back the type that Cyclone uses from here on, which may be an equal one it knew before.
    entity_ = dds_create_topic_sertype(participant, topic.name.c_str(), &type, qos.get(), nullptr, nullptr);
    if (entity_ < 0) ddsi_sertype_unref(type);
    require(entity_, "create it", "topic " + topic.name);
    type_ = type;
  }
  ~CycloneTopic() { dds_delete(entity_); }
  CycloneTopic(const CycloneTopic&) = delete;
  CycloneTopic& operator=(const CycloneTopic&) = delete;
  dds_entity_t entity() const { return entity_; }
  const ddsi_sertype* type() const { return type_; }

 private:
  dds_entity_t entity_;
  const ddsi_sertype* type_ = nullptr;
};

class CyclonePublisher : public Publisher {
 public:
  CyclonePublisher(dds_entity_t participant, const Topic& topic) : topic_(topic), dds_topic_(participant, topic) {
    const QosOwner qos = endpoint_qos(topic, true);
    writer_ =
        require(dds_create_writer(participant, dds_topic_.entity(), qos.get(), nullptr), "create a writer", where());
  }
  ~CyclonePublisher() override { dds_delete(writer_); }

  void publish(std::span<const std::byte> bytes) override {
    check_size(topic_, bytes.size());
    Sample* sample = make_sample(dds_topic_.type(), SDK_DATA, bytes.size());
    std::memcpy(sample->bytes(), bytes.data(), bytes.size());
    sample->timestamp.v = dds_time();
    // A time-out is a lost sample like any other: the application sends again what is not answered.
    const dds_return_t code = dds_writecdr(writer_, sample);  // takes the sample over
    if (code != DDS_RETCODE_OK && code != DDS_RETCODE_TIMEOUT) require(code, "write", where());
  }
  int matched() const override {
    dds_publication_matched_status_t status{};
    dds_get_publication_matched_status(writer_, &status);
    return static_cast<int>(status.current_count);
  }
  Guid guid() const override { return guid_of(writer_); }

 private:
  std::string where() const { return "topic " + topic_.name; }

  const Topic topic_;
  const CycloneTopic dds_topic_;
  dds_entity_t writer_;
};

class CycloneSubscription : public Subscription {
 public:
  CycloneSubscription(dds_entity_t participant, const Topic& topic, Wakeup& wakeup)
      : flag_(wakeup), dds_topic_(participant, topic) {
    const QosOwner qos = endpoint_qos(topic, false);
    const ListenerOwner listener(dds_create_listener(this), dds_delete_listener);
    dds_lset_data_available(listener.get(),
                            [](dds_entity_t, void* self) { static_cast<CycloneSubscription*>(self)->flag_.raise(); });
    reader_ = require(dds_create_reader(participant, dds_topic_.entity(), qos.get(), listener.get()), "create a reader",
                      "topic " + topic.name);
  }
  ~CycloneSubscription() override {
    dds_set_listener(reader_, nullptr);
    dds_delete(reader_);
  }

  bool take(Bytes& out) override {
    if (!flag_.raised()) return false;
    flag_.lower();
    ddsi_serdata* data = nullptr;
    dds_sample_info_t info;
    while (dds_takecdr(reader_, &data, 1, &info, DDS_ANY_STATE) == 1) {
      const Sample* sample = as_sample(data);
      if (info.valid_data) out.assign(sample->bytes(), sample->bytes() + sample->size);
      release_sample(data);
      if (!info.valid_data) continue;
      flag_.raise_quietly();  // there may be more
      return true;
    }
    return false;
  }
  int matched() const override {
    dds_subscription_matched_status_t status{};
    dds_get_subscription_matched_status(reader_, &status);
    return static_cast<int>(status.current_count);
  }
  Guid guid() const override { return guid_of(reader_); }

 private:
  Wakeup::Flag flag_;
  const CycloneTopic dds_topic_;
  dds_entity_t reader_;
};

std::string text_of(const Guid& guid) { return {guid.begin(), guid.end()}; }
std::string text_of(const dds_guid_t& guid) { return text_of(std::to_array(guid.v)); }

/// Returns the type of what a built-in reader reads, once it has read something: this participant itself, at least.
const ddsi_sertype* type_of(dds_entity_t reader) {
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info;
  if (dds_readcdr(reader, &data, 1, &info, DDS_ANY_STATE) != 1) throw Error("cannot read discovery", "cyclonedds");
  const ddsi_sertype* type = data->type;
  ddsi_serdata_unref(data);
  return type;
}

/// Calls `visit(sample, alive)` for each change that a built-in reader has.
template <class Info, class Visit>
void take_all(dds_entity_t reader, Visit visit) {
  while (true) {
    void* samples[1] = {nullptr};
    dds_sample_info_t info;
    if (dds_take(reader, samples, &info, 1, 1) != 1) return;
    visit(*static_cast<const Info*>(samples[0]), info.instance_state == DDS_IST_ALIVE && info.valid_data);
    dds_return_loan(reader, samples, 1);
  }
}

/// Returns the quality of service of a discovered endpoint. Cyclone DDS has filled in the defaults.
EndpointQos qos_of(const dds_builtintopic_endpoint_t& endpoint) {
  const dds_qos_t& qos = *endpoint.qos;
  const dds_data_representation_id_t* const encodings = qos.data_representation.value.ids;
  const std::uint32_t count = qos.present & QP_DATA_REPRESENTATION ? qos.data_representation.value.n : 0;
  const unsigned char kind = endpoint.key.v[sizeof endpoint.key.v - 1] & 0x0F;  // RTPS 2.2, 9.3.1.2: 2, 7 with a key
  return {qos.reliability.kind == DDS_RELIABILITY_RELIABLE,
          qos.durability.kind,
          qos.ownership.kind == DDS_OWNERSHIP_EXCLUSIVE,
          qos.liveliness.kind,
          static_cast<double>(qos.liveliness.lease_duration) / 1e9,
          static_cast<double>(qos.deadline.deadline) / 1e9,
          qos.present & QP_PARTITION && qos.partition.n > 0 ? qos.partition.strs[0] : "",
          std::find(encodings, encodings + count, DDS_DATA_REPRESENTATION_XCDR1) != encodings + count || count == 0,
          kind == 2 || kind == 7};
}

class CycloneMiddleware : public Middleware {
 public:
  explicit CycloneMiddleware(const Network& network) : domain_(Domain::of(network)), addresses_(network.addresses) {
    const QosOwner qos = make_qos();
    dds_qset_entity_name(qos.get(), network.participant.c_str());
    if (!network.user_data.empty()) dds_qset_userdata(qos.get(), network.user_data.data(), network.user_data.size());
    if (!network.security.empty()) {
      for (const auto& [name, value] : cyclonedds_security(network.security))
        dds_qset_prop(qos.get(), name.c_str(), value.c_str());
      discovery_.require_identity();
    }
    participant_ = require(dds_create_participant(network.domain, qos.get(), nullptr), "create a participant",
                           "domain " + std::to_string(network.domain));
    const ListenerOwner listener(dds_create_listener(this), dds_delete_listener);
    dds_lset_data_available(
        listener.get(), [](dds_entity_t, void* self) { static_cast<CycloneMiddleware*>(self)->discovered_ = true; });
    const auto builtin = [&](dds_entity_t topic) {
      return require(dds_create_reader(participant_, topic, nullptr, listener.get()), "watch discovery", "cyclonedds");
    };
    participants_ = builtin(DDS_BUILTIN_TOPIC_DCPSPARTICIPANT);
    publications_ = builtin(DDS_BUILTIN_TOPIC_DCPSPUBLICATION);
    subscriptions_ = builtin(DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION);
    self_ = text_of(guid_of(participant_));
    builtin_type_ = type_of(participants_);
    expect_peers(network, discovery_);
  }
  ~CycloneMiddleware() override {
    for (dds_entity_t reader : {participants_, publications_, subscriptions_}) dds_set_listener(reader, nullptr);
    dds_delete(participant_);
  }

  std::unique_ptr<Publisher> create_publisher(const Topic& topic) override {
    discovery_.register_local_topic(topic, true);
    return std::make_unique<CyclonePublisher>(participant_, topic);
  }
  std::unique_ptr<Subscription> create_subscription(const Topic& topic) override {
    discovery_.register_local_topic(topic, false);
    return std::make_unique<CycloneSubscription>(participant_, topic, wakeup_);
  }
  bool wait(Clock::time_point deadline) override { return wakeup_.wait(deadline); }
  void answer_at_once(const std::function<bool()>& handler) override { wakeup_.set_handler(handler); }
  DiscoveryMonitor& discovery() override {
    if (discovered_.exchange(false)) look_at_discovery();
    return discovery_;
  }
  Guid guid() const override { return guid_of(participant_); }
  std::string name() const override { return "cyclonedds"; }

 private:
  DiscoveryMonitor::Participant described(const std::string& name, const dds_guid_t& guid) const {
    CycloneRemote remote;
    if (!cyclone_remote(builtin_type_, guid.v, &remote)) return {name, "cyclonedds", addresses_};  // of this process
    DiscoveryMonitor::Participant participant{name, vendor_name(remote.vendor[0], remote.vendor[1]), {}};
    for (std::size_t i = 0; i < remote.addresses; ++i) {
      char text[INET_ADDRSTRLEN] = "";
      inet_ntop(AF_INET, remote.address[i], text, sizeof text);
      participant.addresses.push_back(text);
    }
    return participant;
  }

  void look_at_discovery() {
    take_all<dds_builtintopic_participant_t>(
        participants_, [&](const dds_builtintopic_participant_t& found, bool alive) {
          const std::string key = text_of(found.key);
          if (key == self_) return;
          if (!alive) return discovery_.participant_lost(key);
          char* name = nullptr;
          dds_qget_entity_name(found.qos, &name);
          discovery_.participant_found(key, described(name ? name : "", found.key));
          dds_free(name);
        });
    const auto endpoints = [&](dds_entity_t reader, bool writes) {
      take_all<dds_builtintopic_endpoint_t>(reader, [&](const dds_builtintopic_endpoint_t& found, bool alive) {
        if (text_of(found.participant_key) == self_) return;
        if (!alive) return discovery_.endpoint_lost(text_of(found.key));
        discovery_.endpoint_found(text_of(found.key), text_of(found.participant_key), writes, found.topic_name,
                                  found.type_name, qos_of(found));
      });
    };
    endpoints(publications_, true);
    endpoints(subscriptions_, false);
  }

  const std::shared_ptr<Domain> domain_;
  const std::vector<std::string> addresses_;
  std::string self_;
  const ddsi_sertype* builtin_type_ = nullptr;  // of what the built-in readers read; knows the domain
  std::atomic<bool> discovered_{false};
  DiscoveryMonitor discovery_;
  Wakeup wakeup_;
  dds_entity_t participant_, participants_, publications_, subscriptions_;
};

}  // namespace

std::unique_ptr<Middleware> create_cyclonedds(const Network& network) {
  return std::make_unique<CycloneMiddleware>(network);
}

}  // namespace citylearn::internal
