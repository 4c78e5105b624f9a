// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoder_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

#include "core/exchange/incumbent.h"
#include "core/exchange/timing.h"
#include "core/util/random.h"
#include "encoder_service/pipeline/encoding_pipeline.h"
#include "encoder_service/pipeline/learned_files.h"

namespace citylearn {
namespace {

/// An env_service whose traversal has images.
struct Environment {
  msg::TraversalInfo info;  // as it sent it
  Incumbent presence;
  std::uint64_t server = 0;       // incarnation of the encoder_service that completes its observations; 0: none yet
  Clock::time_point completed{};  // when it last completed a TraversalInfo, unless it is this one
  Clock::time_point unserved{};
  std::string fault;                                      // why it cannot be served
  bool too_large_logged = false;                          // that its observations cannot hold the features
  bool read_observations = false, read_requests = false;  // there are readers
  std::optional<msg::Observation> unfinished;             // the newest one, whose features are being made
};

/// Completes the TraversalInfo and Observations of env_services with features, and answers requests for features in
/// their place. Shares them with other encoder_services of the session. Used by one thread.
class EncoderService {
 public:
  explicit EncoderService(const EncoderServiceOptions& options);
  void run(const std::function<bool()>& stop);

 private:
  void take_messages();
  void on_info(const msg::TraversalInfo& info);
  void on_completed_info(const msg::TraversalInfo& info);
  void on_observation(msg::Observation& observation);
  bool complete(Environment& environment, msg::Observation& observation, const EncodedTraversal& traversal);
  void complete_unfinished();
  void on_request(const msg::TraversalRequest& request);
  std::shared_ptr<const ObjectBytes> features(const ObjectKey& key) const;
  void on_status(const msg::ServiceStatus& status);

  void assign_environments();
  void begin_to_serve(const std::string& id, Environment& environment, const EncodedTraversal& traversal);
  void listen_when_needed();
  template <class Message>
  void listen(const std::string& id, bool& reads, bool needed);
  void send_info(const Environment& environment);
  void report();

  std::string find_host(std::uint64_t hash, const std::string& name) const;
  bool alive(const Environment& environment) const { return environment.presence.here(now_); }
  bool serving(const Environment& environment) const { return environment.server == node_.incarnation(); }

  EncoderServiceOptions options_;
  Node node_;
  std::map<std::string, Environment> environments_;  // by id
  struct Peer {
    Presence presence;
    bool beats = false;  // its heartbeat was heard, so it is alive; what it sent may be older
  };
  std::map<std::uint64_t, Peer> peers_;  // other encoder_services, by incarnation

  Clock::time_point now_, next_report_{};
  std::uint64_t reported_ = 0;  // frames encoded before the last report

  // Members, so that a tick allocates nothing.
  msg::TraversalInfo info_;
  msg::Observation observation_;
  ObjectServer server_{[this](const ObjectKey& key) { return features(key); }, node_.traffic.rejected};
  msg::TraversalRequest request_;
  msg::TraversalChunk chunk_, own_chunk_;
  msg::ImageChunk image_;
  msg::DescriptorStatus descriptor_status_;
  msg::DescriptorRequest descriptor_request_;
  msg::DescriptorChunk descriptor_chunk_;
  msg::ServiceStatus status_;

  EncodingPipeline pipeline_;  // last: its threads end first
};

Node::Options node_options(Node::Options options) {
  options.service = "encoder_service";
  if (options.id.empty()) options.id = "encoder";
  return options;
}

EncoderService::EncoderService(const EncoderServiceOptions& options)
    : options_(options),
      node_(node_options(options.node)),
      pipeline_(node_, options_,
                [this](std::uint64_t hash, const std::string& name) { return find_host(hash, name); }) {
  node_.create_reader<msg::ServiceStatus>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::TraversalChunk>();
  node_.create_reader<msg::ImageChunk>();
  node_.create_writer<msg::TraversalInfo>();
}

void EncoderService::run(const std::function<bool()>& stop) {
  spdlog::info("'{}' in session '{}': encoder {}, {}, over {}", node_.options().id, node_.options().session,
               options_.encoder, options_.store.empty() ? "nothing is kept on disk" : "store " + options_.store,
               node_.middleware_name());
  while (!stop()) {
    take_messages();
    now_ = Clock::now();
    pipeline_.advance(now_);
    complete_unfinished();
    assign_environments();
    listen_when_needed();
    if (now_ >= next_report_) report();
    node_.wait(now_ + (pipeline_.busy() ? kEncoderBusyInterval : kStopCheckInterval));
  }
  pipeline_.finish();  // what is encoded already is worth keeping
  node_.report(msg::STOPPING, "stopping");
  spdlog::info("'{}' stops: {} frames encoded{}", node_.options().id, pipeline_.encoded(),
               options_.store.empty() ? "" : ", all of them in the store");
}

void EncoderService::take_messages() {
  now_ = Clock::now();
  while (node_.take(observation_)) on_observation(observation_);
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(request_)) on_request(request_);
  while (node_.take(chunk_)) pipeline_.on_positions(chunk_);
  while (node_.take(image_)) pipeline_.on_image(image_);
  DescriptorExchange& exchange = pipeline_.exchange();
  while (node_.take(descriptor_status_)) exchange.on_status(descriptor_status_, now_);
  while (node_.take(descriptor_request_)) exchange.on_request(descriptor_request_);
  while (node_.take(descriptor_chunk_)) exchange.on_chunk(descriptor_chunk_, now_);
}

/// Handles an announcement that another encoder_service completed. Two with the same encoder share the work; of two
/// with different ones, the one that serves nobody yet is a mistake.
void EncoderService::on_completed_info(const msg::TraversalInfo& info) {
  if (info.encoder_incarnation() == node_.incarnation()) return;
  Peer& peer = peers_[info.encoder_incarnation()];
  peer.presence.heard(now_);
  const FeatureRecipe own = pipeline_.feature_recipe();
  const auto others = FeatureRecipe::parse(info.encoder().c_str());
  if (peer.beats && pipeline_.encoder_ready() && !(others && own.agrees(*others))) {
    const Error wrong(fmt::format("'{}' already encodes with {}, this one with {}", info.encoder_service().c_str(),
                                  info.encoder().c_str(), own.text()),
                      "session '" + node_.options().session + "'",
                      "give both the same encoder, or choose another --session");
    if (std::none_of(environments_.begin(), environments_.end(),
                     [this](const auto& entry) { return serving(entry.second); }))
      throw wrong;
    node_.alarm("encoder", wrong.what());
  }
  const auto found = environments_.find(info.header().sender().c_str());
  if (found == environments_.end()) return;
  // Of two that began to serve the same env_service, both know by this which one continues.
  if (serving(found->second)) {
    if (info.encoder_incarnation() > node_.incarnation()) return;
    spdlog::info("leaves '{}' to '{}'", found->first, info.encoder_service().c_str());
  }
  found->second.server = info.encoder_incarnation();
  found->second.completed = now_;
}

void EncoderService::on_info(const msg::TraversalInfo& info) {
  if (!info.images()) return;
  if (info.encoder_incarnation() != 0) return on_completed_info(info);
  Environment& environment = environments_[info.header().sender().c_str()];
  const Incumbent::Heard heard = environment.presence.hear(info.header().incarnation(), now_);
  if (heard == Incumbent::Heard::kOther) return;
  if (heard == Incumbent::Heard::kSuccessor) {
    environment.server = 0;
    environment.unserved = now_;
    environment.fault.clear();
    environment.too_large_logged = false;
  }
  environment.info = info;
  pipeline_.add(info);
  if (serving(environment)) send_info(environment);
}

void EncoderService::on_observation(msg::Observation& observation) {
  const auto found = environments_.find(observation.header().sender().c_str());
  if (found == environments_.end()) return;
  Environment& environment = found->second;
  if (observation.header().incarnation() != environment.presence.incarnation()) return;
  environment.presence.hear(observation.header().incarnation(), now_);
  // One may be complete already: another encoder_service has sent it.
  if (observation.by_reference() || observation.feature_dimension() != 0 || !serving(environment)) return;
  const EncodedTraversal* traversal = pipeline_.find(observation.traversal_hash());
  if (!traversal || !traversal->ready) return;
  if (complete(environment, observation, *traversal)) {
    environment.unfinished.reset();
  } else if (traversal->is_live) {
    pipeline_.want(traversal->hash, observation.frame());
    environment.unfinished = observation;
  } else {
    ++node_.traffic.rejected;  // of frames that are not on the traversal
  }
}

/// Fills in the features and sends it. Returns false when there are none of a frame.
bool EncoderService::complete(Environment& environment, msg::Observation& observation,
                              const EncodedTraversal& traversal) {
  const auto dimension = static_cast<std::size_t>(traversal.dimension());
  if (observation.frame().size() * dimension > msg::MAX_FEATURES) {
    ++node_.traffic.rejected;
    if (!std::exchange(environment.too_large_logged, true))
      spdlog::error(
          "{} features of {} agents do not fit one observation of '{}' (at most {}): the policy_service must ask for "
          "observations by reference",
          dimension, observation.frame().size(), observation.header().sender().c_str(), msg::MAX_FEATURES);
    return true;
  }
  observation.features().resize(observation.frame().size() * dimension);
  float* to = observation.features().data();
  for (const std::uint32_t frame : observation.frame()) {
    const float* from = traversal.find(frame);
    if (!from) return false;
    to = std::copy_n(from, dimension, to);
  }
  observation.encoder_incarnation() = node_.incarnation();
  observation.feature_dimension() = static_cast<std::uint32_t>(dimension);
  node_.forward(observation);
  return true;
}

/// Sends the observations of robots whose pictures have been encoded meanwhile.
void EncoderService::complete_unfinished() {
  for (auto& [id, environment] : environments_) {
    if (!environment.unfinished) continue;
    const EncodedTraversal* traversal = pipeline_.find(environment.unfinished->traversal_hash());
    if (!serving(environment) || !traversal || complete(environment, *environment.unfinished, *traversal))
      environment.unfinished.reset();
  }
}

void EncoderService::on_request(const msg::TraversalRequest& request) {
  const auto found = environments_.find(request.server().c_str());
  if (found == environments_.end() || !serving(found->second) || request.part() == 0) return;
  const EncodedTraversal* traversal = pipeline_.find(request.hash());
  if (!traversal || !traversal->ready || traversal->is_live) return;
  if (request.part() != static_cast<std::uint32_t>(traversal->dimension())) return;
  send_info(found->second);
  server_.answer(request, own_chunk_, [this] { node_.publish(own_chunk_); });
}

/// Returns features of a traversal that is ready.
std::shared_ptr<const ObjectBytes> EncoderService::features(const ObjectKey& key) const {
  const EncodedTraversal& traversal = *pipeline_.find(key.hash);
  return traversal_object(key, traversal.positions.positions, [&](std::uint32_t frame) {
    return std::span<const float>(traversal.features.col(frame).data(), key.part);
  });
}

void EncoderService::on_status(const msg::ServiceStatus& status) {
  node_.check_twin(status);
  if (const auto found = environments_.find(status.header().sender().c_str()); found != environments_.end())
    if (found->second.presence.incarnation() == status.header().incarnation())
      found->second.presence.hear(status.header().incarnation(), now_);
  if (std::string(status.service().c_str()) != "encoder_service") return;
  pipeline_.exchange().on_heartbeat(status, now_);
  if (status.service_state() == msg::STOPPING)
    peers_.erase(status.header().incarnation());
  else
    peers_[status.header().incarnation()] = {Presence(now_), true};
}

std::string EncoderService::find_host(std::uint64_t hash, const std::string& name) const {
  for (const auto& [id, environment] : environments_)
    if (environment.info.hash() == hash && alive(environment) &&
        (name.empty() || environment.info.traversal().c_str() == name))
      return id;
  return "";
}

/// Each env_service is served by one encoder_service: the one that serves it already, as long as it is alive; else, of
/// those alive, the one that the hash of both ids favours, so that several divide many env_services; else, when that
/// one has not begun, the first that is ready.
void EncoderService::assign_environments() {
  std::erase_if(peers_, [this](const auto& entry) { return !entry.second.presence.here(now_); });
  for (auto& [id, environment] : environments_) {
    // Of two that leave it to each other, both live and neither serves.
    if (serving(environment) || (peers_.contains(environment.server) && now_ < environment.completed + kMaxUnserved))
      continue;
    if (environment.server != 0) {
      spdlog::warn("the encoder_service of '{}' serves it no longer", id);
      environment.server = 0;
      environment.unserved = now_;
    }
    const EncodedTraversal* traversal = pipeline_.find(environment.info.hash());
    if (!alive(environment) || !traversal || !traversal->ready || !environment.fault.empty()) continue;
    const std::uint64_t environment_hash = mix_text(id);
    const std::uint64_t own = mix_seeds({environment_hash, node_.incarnation()});
    bool favoured = true;
    for (const auto& [incarnation, peer] : peers_) favoured &= own > mix_seeds({environment_hash, incarnation});
    if (favoured || now_ >= environment.unserved + kSilence) begin_to_serve(id, environment, *traversal);
  }
}

void EncoderService::begin_to_serve(const std::string& id, Environment& environment,
                                    const EncodedTraversal& traversal) {
  const auto dimension = static_cast<std::uint64_t>(traversal.dimension());
  if (dimension > msg::MAX_DIMENSION) {
    environment.fault =
        fmt::format("{} features a frame are too many for '{}' (at most {}): give a smaller --dimension", dimension, id,
                    msg::MAX_DIMENSION);
    spdlog::error("{}", environment.fault);
    return;
  }
  environment.server = node_.incarnation();
  spdlog::info("serves '{}'", id);
  send_info(environment);
}

/// Reads the requests to the env_services that it serves, and their observations unless these go by reference: taking
/// in thousands a second would cost them and this service time.
void EncoderService::listen_when_needed() {
  for (auto& [id, environment] : environments_) {
    const bool requests = serving(environment) && alive(environment);
    const bool observations = requests && !environment.info.by_reference();
    listen<msg::TraversalRequest>(id, environment.read_requests, requests);
    listen<msg::Observation>(id, environment.read_observations, observations);
  }
}

/// Creates or deletes the reader of an env_service's topic.
template <class Message>
void EncoderService::listen(const std::string& id, bool& reads, bool needed) {
  if (reads == needed) return;
  reads = needed;
  needed ? node_.create_reader_at<Message>(id) : node_.delete_reader_at<Message>(id);
}

void EncoderService::send_info(const Environment& environment) {
  msg::TraversalInfo info = environment.info;
  const EncodedTraversal& traversal = *pipeline_.find(info.hash());
  info.feature_dimension() = static_cast<std::uint32_t>(traversal.dimension());
  info.encoder() = pipeline_.feature_recipe().text().c_str();
  info.encoder_service() = node_.options().id.c_str();
  info.encoder_incarnation() = node_.incarnation();
  node_.forward(info);
}

void EncoderService::report() {
  next_report_ = now_ + kHeartbeat;
  msg::State state = msg::WAITING;
  std::string activity;
  int served = 0;
  for (const auto& [id, environment] : environments_) {
    served += serving(environment) && alive(environment);
    if (alive(environment) && !environment.fault.empty()) {
      state = msg::FAILED;
      activity = environment.fault;
    }
  }
  const auto status = pipeline_.status(now_);
  if (status && (activity.empty() || status->first == msg::FAILED)) std::tie(state, activity) = *status;
  if (activity.empty() && served > 0) {
    state = msg::RUNNING;
    activity = fmt::format("completes the observations of {} env_service{}", served, served == 1 ? "" : "s");
  }
  if (activity.empty())
    activity = environments_.empty() ? "waiting for an env_service with images" : "ready; others serve";
  node_.report(state, activity, static_cast<float>(pipeline_.encoded() - reported_));
  reported_ = pipeline_.encoded();
}

}  // namespace

void run_encoder_service(const EncoderServiceOptions& options, const std::function<bool()>& stop) {
  EncoderService(options).run(stop);
}

}  // namespace citylearn
