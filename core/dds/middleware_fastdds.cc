// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <limits>

#include "core/dds/middleware_fastdds_api.h"
#include "core/dds/middleware_fastdds_listener.h"
#include "core/dds/middleware_fastdds_transport.h"
#include "core/dds/middleware_fastdds_type.h"
#include "core/dds/middleware_internal.h"
#include "core/dds/request_identity.h"
#include "core/dds/security.h"
#include "core/dds/wakeup.h"
#include "core/util/error.h"

namespace citylearn::internal {
namespace {

namespace dds = fast::dds;
namespace rtps = fast::rtps;
using fast::Duration;
using fast::Raw;
using fast::RawType;

constexpr std::uint32_t kSocketBuffer = 4 << 20;
constexpr int kHandshake = 16384;    // bytes; twice what a service's certificate and permissions take
constexpr int kAnnouncement = 1252;  // bytes; a participant's announcement is not cut, and smaller packets lost it

// While a sample is not acknowledged, a writer sends its readers a heartbeat so often, in nanoseconds. A reader asks
// for what it lacks once each time. Packets get lost between hosts, hardly ever on loopback.
constexpr std::uint32_t kLoopbackHeartbeat = 10'000'000;
constexpr std::uint32_t kHeartbeat = 2'000'000;
// Fast DDS keeps the period however long answers take. With many services the heartbeats themselves delayed the
// answers: of 48 env_services at one policy_service, each made 4 to 17 ticks/s instead of 52 to 109.
constexpr std::uint32_t kHeartbeatPerParticipant = 400'000;
constexpr std::uint32_t kMaxHeartbeat = 100'000'000;
constexpr std::uint32_t kHeartbeatToAll = 20'000'000;

// The most samples of a writer's history in a secured session: as many as the chunks that one request brings. With
// security Fast DDS 2.9 was seen to end its process where much of a history went out again at once. So many records of
// up to 1 KB fit one message.
constexpr int kSecuredDepth = 64;

// Fast announces a new participant before it reads what others answer. An answer that comes at once is lost, and the
// next one would come with the period of announcements. So each one is given twice.
constexpr std::chrono::milliseconds kAnswerInterval{10};

/// Fast's own warnings and errors, into our log instead of onto standard output.
class LogForwarder : public dds::LogConsumer {
 public:
  void Consume(const dds::Log::Entry& entry) override {
    if (const auto line = explain_security(entry.message)) return log_security_event(*line);
    if (entry.kind == dds::Log::Kind::Error)
      logger_->warn("fastdds: {} ({})", entry.message, entry.context.category);
    else
      logger_->debug("fastdds: {} ({})", entry.message, entry.context.category);
  }

 private:
  // Fast's thread may still have something to say when spdlog is gone already, at the end of the program.
  const std::shared_ptr<spdlog::logger> logger_ = spdlog::default_logger();
};

void forward_log_once() {
  static const bool done = [] {
    dds::Log::ClearConsumers();
    dds::Log::RegisterConsumer(std::make_unique<LogForwarder>());
    dds::Log::SetVerbosity(dds::Log::Kind::Warning);
    return true;
  }();
  static_cast<void>(done);
}

/// Remembers when to announce this participant once more because another one was discovered.
class DiscoveryListener : public FastListener {
 public:
  using FastListener::FastListener;
  Clock::time_point answer_at() const { return answer_at_; }
  void answered() { answer_at_ = Clock::time_point::max(); }
  void participant_found() override { answer_at_ = Clock::now() + kAnswerInterval; }

 private:
  std::atomic<Clock::time_point> answer_at_{Clock::time_point::max()};
};

std::vector<rtps::octet> octets_of(const std::string& text) { return {text.begin(), text.end()}; }

Guid guid_of(const rtps::GUID_t& guid) {
  Guid result;
  std::copy_n(guid.entityId.value, 4, std::copy_n(guid.guidPrefix.value, 12, result.begin()));
  return result;
}

rtps::GUID_t guid_from(const Guid& guid) {
  rtps::GUID_t result;
  std::copy_n(guid.begin(), 12, result.guidPrefix.value);
  std::copy_n(guid.begin() + 12, 4, result.entityId.value);
  return result;
}

/// Returns the identity of a request, as rmw_fastrtps's ServiceListener does: clients say which reader awaits the
/// reply, or else it is known by their writer.
RequestIdentity identity_of(const dds::SampleInfo& info) {
  const rtps::SampleIdentity& request = info.sample_identity;
  const rtps::GUID_t &reader = info.related_sample_identity.writer_guid(), &writer = request.writer_guid();
  return {guid_of(reader != rtps::GUID_t::unknown() ? reader : writer),
          static_cast<std::int64_t>(request.sequence_number().to64long())};
}

/// Returns what writers and readers have in common: nothing is lost of the last `depth` samples.
template <class Qos>
Qos reliable_qos(const Topic& topic, int depth) {
  Qos qos;
  qos.user_data().data_vec(octets_of(topic.user_data));
  qos.reliability().kind = dds::RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = is_kept(topic.profile) ? dds::TRANSIENT_LOCAL_DURABILITY_QOS : dds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = dds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = depth;
  qos.resource_limits().max_instances = 1;
  qos.resource_limits().max_samples = depth;
  qos.resource_limits().max_samples_per_instance = depth;
  qos.resource_limits().allocated_samples = 1;
  qos.endpoint().history_memory_policy = rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
  qos.data_sharing().off();
  return qos;
}

/// A topic that is deleted with its last writer or reader.
using TopicOwner = std::shared_ptr<dds::Topic>;

class FastPublisher : public Publisher {
 public:
  FastPublisher(dds::Publisher* publisher, TopicOwner dds_topic, const Topic& topic, std::uint32_t heartbeat,
                int most_kept)
      : publisher_(publisher), topic_(topic), dds_topic_(std::move(dds_topic)) {
    const int depth = std::min(depth_of(topic.profile).writer, most_kept);
    auto qos = reliable_qos<dds::DataWriterQos>(topic, depth);
    qos.reliability().max_blocking_time = Duration(0, std::chrono::nanoseconds(kBlocking).count());
    qos.durability_service().history_kind = dds::KEEP_LAST_HISTORY_QOS;
    qos.durability_service().history_depth = depth;
    qos.publish_mode().kind = dds::SYNCHRONOUS_PUBLISH_MODE;
    fast::repair_at_once(qos, heartbeat);
    // A full history, as it always is after a while, would make Fast add a heartbeat to each sample, which wakes a
    // thread on either side to send and to take an acknowledgement: a third of the round trip. The period above is
    // enough.
    qos.reliable_writer_qos().disable_heartbeat_piggyback = true;
    writer_ = publisher_->create_datawriter(dds_topic_.get(), qos);
    if (!writer_) throw Error("fastdds cannot create a writer", "topic " + topic.name);
  }
  ~FastPublisher() override {
    // Fast DDS 2.9 takes a writer's samples apart while its heartbeat may still walk over them, for ever then. It walks
    // as long as a reader has not acknowledged (one that was killed). Where there are no samples it does not.
    std::size_t removed = 0;
    writer_->clear_history(&removed);
    publisher_->delete_datawriter(writer_);
  }

  void publish(std::span<const std::byte> sample) override {
    check_size(topic_, sample.size());
    if (is_reply_) return publish_reply(sample);
    Raw raw{sample};
    // A time-out is a lost sample like any other: the application sends again what is not answered. So is a history
    // without room because other threads still send what is in it, as release 3 was seen to report under load.
    const fast::ReturnCode code = writer_->write(&raw, rtps::InstanceHandle_t());
    if (!fast::is_ok(code) && !fast::is_lost(code))
      throw Error("fastdds cannot write (code " + std::to_string(fast::number_of(code)) + ")", "topic " + topic_.name);
  }
  int matched() const override {
    dds::PublicationMatchedStatus status;
    writer_->get_publication_matched_status(status);
    return status.current_count;
  }
  Guid guid() const override { return guid_of(writer_->guid()); }
  void wait_for_acknowledgments(Clock::time_point deadline) override {
    const auto left = std::chrono::duration_cast<std::chrono::nanoseconds>(deadline - Clock::now()).count();
    if (left > 0) writer_->wait_for_acknowledgments(Duration(static_cast<long double>(left) * 1e-9L));
  }

 private:
  /// Writes a reply without the identity of its request, which goes beside it.
  void publish_reply(std::span<const std::byte> sample) {
    RequestIdentity request;
    std::memcpy(&request, sample.subspan(kIdentityOffset).data(), sizeof request);
    const auto content = sample.subspan(kIdentityOffset + sizeof request);
    Bytes bytes(sample.begin(), sample.begin() + kIdentityOffset);
    bytes.insert(bytes.end(), content.begin(), content.end());
    rtps::WriteParams answers;
    auto& identity = answers.related_sample_identity();
    identity.writer_guid() = guid_from(request.client);
    identity.sequence_number() = {static_cast<std::int32_t>(request.sequence >> 32),
                                  static_cast<std::uint32_t>(request.sequence)};
    Raw raw{bytes};
    writer_->write(&raw, answers);  // one that is not written is lost like any other
  }

  dds::Publisher* const publisher_;
  const Topic topic_;
  const bool is_reply_ = topic_.name.starts_with(kReplyPrefix);
  const TopicOwner dds_topic_;
  dds::DataWriter* writer_;
};

class FastSubscription : public Subscription, private dds::DataReaderListener {
 public:
  FastSubscription(dds::Subscriber* subscriber, TopicOwner dds_topic, const Topic& topic, Wakeup& wakeup)
      : subscriber_(subscriber),
        is_request_(topic.name.starts_with(kRequestPrefix)),
        flag_(wakeup),
        dds_topic_(std::move(dds_topic)) {
    auto qos = reliable_qos<dds::DataReaderQos>(topic, depth_of(topic.profile).reader);
    if (topic.profile == Profile::kRos2) qos.reliability().kind = dds::BEST_EFFORT_RELIABILITY_QOS;
    fast::repair_at_once(qos);
    reader_ = subscriber_->create_datareader(dds_topic_.get(), qos, this, dds::StatusMask::data_available());
    if (!reader_) throw Error("fastdds cannot create a reader", "topic " + topic.name);
  }
  ~FastSubscription() override {
    reader_->set_listener(nullptr);
    subscriber_->delete_datareader(reader_);
  }

  bool take(Bytes& sample) override {
    if (!flag_.raised()) return false;
    flag_.lower();
    Raw raw{{}, &sample};
    dds::SampleInfo info;
    while (fast::is_ok(reader_->take_next_sample(&raw, &info))) {
      if (!info.valid_data) continue;
      flag_.raise_quietly();  // there may be more
      if (is_request_ && sample.size() >= kIdentityOffset) {
        const RequestIdentity identity = identity_of(info);
        const auto bytes = std::as_bytes(std::span(&identity, 1));
        sample.insert(sample.begin() + kIdentityOffset, bytes.begin(), bytes.end());
      }
      return true;
    }
    return false;
  }
  int matched() const override {
    dds::SubscriptionMatchedStatus status;
    reader_->get_subscription_matched_status(status);
    return status.current_count;
  }
  Guid guid() const override { return guid_of(reader_->guid()); }

 private:
  void on_data_available(dds::DataReader*) override { flag_.raise(); }

  dds::Subscriber* const subscriber_;
  const bool is_request_;
  Wakeup::Flag flag_;
  const TopicOwner dds_topic_;
  dds::DataReader* reader_;
};

rtps::Locator_t locator(const std::string& address, int port) {
  rtps::Locator_t result;
  rtps::IPLocator::createLocator(LOCATOR_KIND_UDPv4, address, static_cast<std::uint32_t>(port), result);
  return result;
}

/// Finds other participants by servers instead of announcements, as a client that hears of all of them, so that it
/// reports wrong types too.
void join(const std::vector<Network::Peer>& servers, rtps::DiscoverySettings& discovery) {
#if CITYLEARN_FASTDDS_RELEASE == 2
  discovery.discoveryProtocol = rtps::DiscoveryProtocol_t::SUPER_CLIENT;
  for (const Network::Peer& server : servers) {
    rtps::RemoteServerAttributes attributes;
    attributes.metatrafficUnicastLocatorList.push_back(locator(server.address, server.port));
    // Fast tells its servers apart by number: the first of everybody's list is the one started with `-i 0`.
    rtps::get_server_client_default_guidPrefix(static_cast<int>(discovery.m_DiscoveryServers.size()),
                                               attributes.guidPrefix);
    discovery.m_DiscoveryServers.push_back(attributes);
  }
#else
  discovery.discoveryProtocol = rtps::DiscoveryProtocol::SUPER_CLIENT;
  for (const Network::Peer& server : servers)
    discovery.m_DiscoveryServers.push_back(locator(server.address, server.port));
#endif
}

/// Takes the first free ports of this host's addresses.
void listen_at(const Network& network, dds::WireProtocolConfigQos& wire) {
  const int port = discovery_port(network.domain, free_index(network));
  for (const std::string& address : network.addresses) {
    wire.builtin.metatrafficUnicastLocatorList.push_back(locator(address, port));  // and so no multicast
    wire.default_unicast_locator_list.push_back(locator(address, port + 1));
  }
}

class FastMiddleware : public Middleware {
 public:
  explicit FastMiddleware(const Network& network)
      : heartbeat_(network.loopback_only ? kLoopbackHeartbeat : kHeartbeat),
        most_kept_(network.security.empty() ? std::numeric_limits<int>::max() : kSecuredDepth),
        user_data_(network.user_data),
        answers_again_(network.security.empty() && !(network.multicast && std::getenv("ROS_DISCOVERY_SERVER"))) {
    forward_log_once();
    dds::DomainParticipantQos qos;
    qos.name(network.participant);
    qos.user_data().data_vec(octets_of(user_data_));
    auto udp = std::make_shared<fast::transport::UDPv4TransportDescriptor>();
    if (!network.multicast) udp->interfaceWhiteList = network.addresses;
    udp->maxInitialPeersRange = kParticipants;
    udp->sendBufferSize = kSocketBuffer;
    udp->receiveBufferSize = kSocketBuffer;
    // Fast does not cut what two sides say to prove who they are: certificate and permissions must fit one message.
    const int largest = std::max(network.datagram, network.security.empty() ? kAnnouncement : kHandshake);
    const auto everybody =
        network.multicast ? locator("239.255.0.1", announcement_port(network.domain)) : rtps::Locator_t();
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports = {
        std::make_shared<UnicastDescriptor>(udp, static_cast<std::uint32_t>(largest), everybody)};
    qos.transport().send_socket_buffer_size = kSocketBuffer;
    qos.transport().listen_socket_buffer_size = kSocketBuffer;

    auto& wire = qos.wire_protocol();
    // Fast would give a new participant the number, and so the GUID, of one that left; others then take its first
    // announcements for old ones.
    static std::atomic<int> started{0};
    wire.participant_id = started++;
    if (!network.multicast) listen_at(network, wire);
    // Peers would replace Fast's own, which is everybody at the address of RTPS 2.2, 9.6.1.4.1.
    if (network.multicast && !network.peers.empty()) wire.builtin.initialPeersList.push_back(everybody);
    if (network.discovery_servers.empty())
      for (const Network::Peer& peer : network.peers)
        wire.builtin.initialPeersList.push_back(locator(peer.address, peer.port));
    else
      join(network.discovery_servers, wire.builtin.discovery_config);
    expect_peers(network, discovery_);
    wire.builtin.discovery_config.leaseDuration = Duration(10, 0u);
    // Two participants that start at once may miss each other's first announcement; then this is how long they wait.
    wire.builtin.discovery_config.leaseDuration_announcementperiod = Duration(1, 0u);
#if CITYLEARN_FASTDDS_RELEASE == 2
    wire.builtin.typelookup_config.use_client = false;
    wire.builtin.typelookup_config.use_server = false;
#endif
    if (!network.security.empty()) {
      for (const auto& [name, value] : fastdds_security(network.security))
        qos.properties().properties().emplace_back(name, value);
      discovery_.require_identity();
    }

    participant_ = dds::DomainParticipantFactory::get_instance()->create_participant(
        network.domain, qos, &discovery_listener_, dds::StatusMask::none());
    if (!participant_)
      throw Error("fastdds cannot start a participant in domain " + std::to_string(network.domain) + " on " +
                  network.interfaces);
    publisher_ = participant_->create_publisher(dds::PUBLISHER_QOS_DEFAULT);
    subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  }

  ~FastMiddleware() override {
    participant_->set_listener(nullptr);
    participant_->delete_subscriber(subscriber_);
    participant_->delete_publisher(publisher_);
    dds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }

  std::unique_ptr<Publisher> create_publisher(const Topic& topic) override {
    return std::make_unique<FastPublisher>(publisher_, own(topic, true), topic, heartbeat_period(topic), most_kept_);
  }
  std::unique_ptr<Subscription> create_subscription(const Topic& topic) override {
    return std::make_unique<FastSubscription>(subscriber_, own(topic, false), topic, wakeup_);
  }
  bool wait(Clock::time_point deadline) override {
    if (answers_again_ && Clock::now() >= discovery_listener_.answer_at()) announce();
    return wakeup_.wait(deadline);
  }
  void answer_at_once(const std::function<bool()>& handler) override { wakeup_.set_handler(handler); }
  DiscoveryMonitor& discovery() override { return discovery_; }
  Guid guid() const override { return guid_of(participant_->guid()); }
  std::string name() const override { return "fastdds"; }

 private:
  /// Announces this participant to all. Fast does so when its user data change.
  void announce() {
    discovery_listener_.answered();
    dds::DomainParticipantQos qos = participant_->get_qos();
    qos.user_data().data_vec(octets_of(user_data_ + "n=" + std::to_string(++announcement_) + ";"));
    participant_->set_qos(qos);
  }
  /// Returns the period for a new writer. One that all services read sends each of them every heartbeat until the last
  /// one has answered, and it has most often been created before any other participant was discovered. What a service
  /// says last must still be repeated many times within kFlushTimeout.
  std::uint32_t heartbeat_period(const Topic& topic) {
    if (topic.read_by_all) return kHeartbeatToAll;
    const auto participants = static_cast<std::uint32_t>(std::min<std::size_t>(discovery_.participants().size(), 1000));
    return std::clamp(kHeartbeatPerParticipant * participants, heartbeat_, kMaxHeartbeat);
  }
  TopicOwner own(const Topic& topic, bool writes) {
    discovery_.register_local_topic(topic, writes);
    if (TopicOwner known = topics_[topic.name].lock()) return known;  // Fast refuses a second topic of one name
    // One type may serve several topics; Fast keeps one description of it.
    if (const dds::TypeSupport type = participant_->find_type(topic.type); !type.empty())
      static_cast<RawType&>(*type).make_room(topic.largest);
    else
      participant_->register_type(dds::TypeSupport(new RawType(topic.type, topic.largest)));
    dds::Topic* const made = participant_->create_topic(topic.name, topic.type, dds::TOPIC_QOS_DEFAULT);
    if (!made) {
      topics_.erase(topic.name);
      throw Error("fastdds cannot create it", "topic " + topic.name);
    }
    TopicOwner owner(made, [this](dds::Topic* last) {
      topics_.erase(last->get_name());
      participant_->delete_topic(last);
    });
    topics_[topic.name] = owner;
    return owner;
  }

  const std::uint32_t heartbeat_;  // ns, the shortest period
  const int most_kept_;            // samples of a writer
  const std::string user_data_;
  // In a secured session participants repeat what they say to prove who they are; servers tell of everybody.
  const bool answers_again_;
  std::uint8_t announcement_ = 0;
  DiscoveryMonitor discovery_;
  DiscoveryListener discovery_listener_{discovery_};
  Wakeup wakeup_;
  std::map<std::string, std::weak_ptr<dds::Topic>> topics_;  // those in use
  dds::DomainParticipant* participant_ = nullptr;
  dds::Publisher* publisher_ = nullptr;
  dds::Subscriber* subscriber_ = nullptr;
};

}  // namespace

std::unique_ptr<Middleware> create_fastdds(const Network& network) { return std::make_unique<FastMiddleware>(network); }

}  // namespace citylearn::internal
