// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoder_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <set>
#include <utility>

#include "core/util/files.h"
#include "core/util/random.h"
#include "core/wire/presence.h"
#include "core/wire/transfer.h"
#include "encoder_service/background.h"
#include "encoder_service/image_fetch.h"
#include "encoder_service/traversal_work.h"

namespace citylearn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kIdle{50};  // between looks at `stop`
constexpr milliseconds kBusy{5};   // between looks at what is done behind
constexpr seconds kProgress{2};
constexpr std::size_t kBytesAhead = std::size_t{64} << 20;  // of a traversal's pictures that wait to be encoded

std::uint64_t hash_of(const std::string& text) {
  std::uint64_t hash = 0;
  for (const char c : text) hash = mix_seeds({hash, static_cast<unsigned char>(c)});
  return hash;
}

std::string duration(double length) {
  if (length < 90) return fmt::format("{:.0f} s", length);
  return length < 5400 ? fmt::format("{:.0f} min", length / 60) : fmt::format("{:.1f} h", length / 3600);
}

/// Pictures that came over the wire, for the thread behind.
struct Batch {
  std::uint64_t traversal = 0;
  std::vector<FetchedImage> images;
  std::vector<int> frames;  // of those encoded: a column each of
  Eigen::MatrixXf descriptors;
  std::vector<std::pair<int, std::string>> faults;  // frame, why
};

/// One traversal on its way from pictures to features.
struct Route {
  Route(Node& node, const msg::TraversalInfo& info)
      : name(info.traversal().c_str()),
        hash(info.hash()),
        frames(static_cast<int>(info.frames())),
        images(node, hash, frames),
        positions({hash, info.frames(), 0}) {}

  std::string name;
  std::uint64_t hash;
  int frames;
  ImageFetch images;
  Transfer positions;

  std::unique_ptr<TraversalWork> work;
  Clock::time_point since{}, next_word{};
  int behind = 0;         // pictures given to the thread behind
  std::size_t bytes = 0;  // of pictures that have come and are not encoded yet
  bool reducing = false;
  std::string fault;         // why it is refused
  Eigen::MatrixXf features;  // d x F once ready
  bool ready = false;
};

/// An env_service whose traversal has images.
struct Environment {
  msg::TraversalInfo info;  // as it sent it
  Presence presence;
  std::uint64_t server = 0;  // incarnation of the encoder_service that completes its observations; 0: nobody yet
  Clock::time_point unserved{};
  std::string fault;      // why it cannot be served
  bool too_many = false;  // it was said that its observations cannot hold the features
};

class EncoderService {
 public:
  explicit EncoderService(const EncoderServiceOptions& options);
  void run(const std::function<bool()>& stop);

 private:
  void take_all();
  void on_info(const msg::TraversalInfo& info);
  void on_observation(msg::Observation& observation);
  void on_request(const msg::TraversalRequest& request);
  void on_positions(const msg::TraversalChunk& chunk);
  void on_image(const msg::ImageChunk& chunk);
  void on_status(const msg::ServiceStatus& status);

  void learn_encoder();
  void finish_lessons();
  void advance();
  void feed();
  void feed(Route& route);
  void flush(Route& route, bool all);
  void encoded(Batch& batch);
  void reduce(Route& route);
  void ask();
  void decide_who_serves();
  void listen_when_needed();
  void send_info(const Environment& environment);
  void report();

  bool needs_reference() const {
    return options_.reduction.dimension > 0 || options_.reduction.centring == Centring::kReference ||
           options_.reduction.centring == Centring::kRunning;
  }
  Route* reference();
  const Environment* host(const Route& route) const;
  bool alive(const Environment& environment) const { return environment.presence.here(now_); }
  bool serving(const Environment& environment) const { return environment.server == node_.incarnation(); }
  bool busy() const;
  std::string learned_path(const std::string& what, const std::string& suffix) const;
  std::string recipe_of_features() const;

  EncoderServiceOptions options_;
  Node node_;
  std::unique_ptr<Encoder> encoder_;  // used by the thread behind, but for its spec
  std::string recipe_;                // the encoder's name and parameters, before it has learned anything
  bool learning_ = false, learned_ = false;
  Encoder::Spec spec_;  // once learned_
  std::vector<FetchedImage> lessons_;
  std::shared_ptr<const Reduction> reduction_;

  std::map<std::uint64_t, std::unique_ptr<Route>> routes_;
  std::map<std::string, Environment> environments_;
  struct Peer {
    Presence presence;
    bool beats = false;  // its heartbeat was heard, so it lives; what it sent may be older
  };
  std::map<std::uint64_t, Peer> peers_;                         // other encoder_services, by incarnation
  std::map<std::uint64_t, std::vector<FetchedImage>> waiting_;  // pictures that wait for a full batch, by traversal

  Clock::time_point now_, next_report_{};
  std::uint64_t encoded_ = 0;   // frames
  std::uint64_t reported_ = 0;  // of them, before the last report

  bool listening_ = true;  // to observations

  msg::TraversalInfo info_;
  msg::Observation observation_;
  msg::TraversalRequest request_, own_request_;
  msg::TraversalChunk chunk_, own_chunk_;
  msg::ImageChunk image_;
  msg::ServiceStatus status_;

  // Last: their threads end before what they use. Reductions are learned while other traversals are encoded.
  Background encoding_, reducing_;
};

Node::Options named(Node::Options options) {
  options.service = "encoder_service";
  if (options.id.empty()) options.id = "encoder";
  return options;
}

EncoderService::EncoderService(const EncoderServiceOptions& options) : options_(options), node_(named(options.node)) {
  const auto& entry = EncoderRegistry::instance().find("encoder", options_.encoder);
  const Parameters parameters("encoder " + entry.name, entry.parameters, options_.parameters);
  encoder_ = entry.create(parameters, options_.files);
  recipe_ = entry.name;
  for (const auto& [name, value] : parameters.values()) recipe_ += fmt::format(" {}={:g}", name, value);
  for (const std::string& file :
       {options_.files.model, options_.files.layer, options_.files.preset, options_.files.head})
    recipe_ += " " + file;
  if (encoder_->lessons() == 0) {
    learned_ = true;
    spec_ = encoder_->spec();
    spdlog::info("encoder {}: {} numbers a picture", spec_.name, spec_.dimension);
  }
  if (!options_.store.empty()) {
    std::error_code error;
    std::filesystem::create_directories(options_.store, error);
    if (error) throw Error(error.message(), options_.store, "choose another --store");
  }
  node_.create_reader<msg::ServiceStatus>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::Observation>();
  node_.create_reader<msg::TraversalRequest>();
  node_.create_reader<msg::TraversalChunk>();
  node_.create_reader<msg::ImageChunk>();
  node_.create_writer<msg::TraversalInfo>();
  node_.create_writer<msg::Observation>();
  node_.create_writer<msg::TraversalRequest>();
  node_.create_writer<msg::TraversalChunk>();
  node_.create_writer<msg::ImageRequest>();
}

void EncoderService::run(const std::function<bool()>& stop) {
  spdlog::info("'{}' in session '{}': encoder {}, {}, over {}", node_.options().id, node_.options().session,
               options_.encoder, options_.store.empty() ? "nothing is kept on disk" : "store " + options_.store,
               node_.middleware_name());
  while (!stop()) {
    take_all();
    now_ = Clock::now();
    encoding_.finished();
    reducing_.finished();
    advance();
    ask();
    decide_who_serves();
    listen_when_needed();
    if (now_ >= next_report_) report();
    node_.wait(now_ + (busy() ? kBusy : kIdle));
  }
  // What the thread behind has at hand is still worth keeping.
  encoding_.finished();
  node_.report(msg::STOPPING, "stopping");
  spdlog::info("'{}' stops: {} frames encoded{}", node_.options().id, encoded_,
               options_.store.empty() ? "" : ", all of them in the store");
}

void EncoderService::take_all() {
  now_ = Clock::now();
  while (listening_ && node_.take(observation_)) on_observation(observation_);
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(request_)) on_request(request_);
  while (node_.take(chunk_)) on_positions(chunk_);
  while (node_.take(image_)) on_image(image_);
}

// ------------------------------------------------------------------------------------------------ what is heard

void EncoderService::on_info(const msg::TraversalInfo& info) {
  if (!info.images()) return;
  const std::string id = info.header().sender().c_str();
  if (info.encoder_incarnation() != 0) {
    if (info.encoder_incarnation() == node_.incarnation()) return;
    // Another encoder_service completed it. Two of one kind share the work; of two kinds the later one is a mistake.
    Peer& peer = peers_[info.encoder_incarnation()];
    peer.presence.heard(now_);
    if (peer.beats && learned_ && info.encoder().c_str() != recipe_of_features() &&
        info.encoder_incarnation() < node_.incarnation())
      throw Error(fmt::format("'{}' already encodes with {}, this one would with {}", info.encoder_service().c_str(),
                              info.encoder().c_str(), recipe_of_features()),
                  "run '" + node_.options().session + "'", "give both the same encoder, or choose another --session");
    if (const auto found = environments_.find(id); found != environments_.end()) {
      Environment& environment = found->second;
      // Of two that serve the same one, the earlier goes on.
      if (!serving(environment) || info.encoder_incarnation() < node_.incarnation())
        environment.server = info.encoder_incarnation();
    }
    return;
  }
  Environment& environment = environments_[id];
  if (environment.info.header().incarnation() > info.header().incarnation() && alive(environment)) return;
  const bool fresh = environment.info.header().incarnation() != info.header().incarnation();
  environment.info = info;
  environment.presence.heard(now_);
  if (fresh) {
    environment.server = 0;
    environment.unserved = now_;
    environment.fault.clear();
    environment.too_many = false;
  }
  if (!routes_.count(info.hash())) {
    spdlog::info("traversal {} of {}: {} frames, from '{}'", info.traversal().c_str(), info.dataset().c_str(),
                 info.frames(), id);
    routes_[info.hash()] = std::make_unique<Route>(node_, info);
  }
  if (serving(environment)) send_info(environment);
}

void EncoderService::on_observation(msg::Observation& observation) {
  const auto found = environments_.find(observation.header().sender().c_str());
  if (found == environments_.end()) return;
  Environment& environment = found->second;
  if (observation.header().incarnation() != environment.info.header().incarnation()) return;
  environment.presence.heard(now_);
  // Some are complete: from another encoder_service, or from an env_service that has its features by now.
  if (observation.by_reference() || observation.feature_dimension() != 0 || !serving(environment)) return;
  const auto route = routes_.find(observation.traversal_hash());
  if (route == routes_.end() || !route->second->ready) return;
  const Eigen::MatrixXf& features = route->second->features;
  const auto dimension = static_cast<std::size_t>(features.rows());
  if (observation.frame().size() * dimension > msg::MAX_FEATURES) {
    ++node_.traffic.rejected;
    if (!std::exchange(environment.too_many, true))
      spdlog::error(
          "{} features of {} agents do not fit one observation of '{}' (at most {}): the policy_service must ask for "
          "observations by reference",
          dimension, observation.frame().size(), found->first, msg::MAX_FEATURES);
    return;
  }
  observation.encoder_incarnation() = node_.incarnation();
  observation.feature_dimension() = static_cast<std::uint32_t>(dimension);
  observation.features().resize(observation.frame().size() * dimension);
  float* to = observation.features().data();
  for (const std::uint32_t frame : observation.frame()) {
    if (frame >= static_cast<std::uint32_t>(features.cols())) {
      ++node_.traffic.rejected;
      return;
    }
    to = std::copy_n(features.col(frame).data(), dimension, to);
  }
  node_.forward(observation);
}

void EncoderService::on_request(const msg::TraversalRequest& request) {
  const auto found = environments_.find(request.environment().c_str());
  if (found == environments_.end() || !serving(found->second) || request.feature_dimension() == 0) return;
  const auto place = routes_.find(request.hash());
  if (place == routes_.end() || !place->second->ready) return;
  const Route& route = *place->second;
  const auto dimension = static_cast<std::size_t>(route.features.rows());
  if (request.feature_dimension() != dimension && request.feature_dimension() != msg::ANY_DIMENSION) return;
  // An env_service that has them by now answers itself.
  if (found->second.info.feature_dimension() != 0) return;
  const ChunkLayout layout(static_cast<std::uint32_t>(route.frames), static_cast<std::uint32_t>(dimension));
  send_info(found->second);
  for (const std::uint32_t index : request.chunks()) {
    if (index >= layout.chunks()) {
      ++node_.traffic.rejected;
      continue;
    }
    own_chunk_.hash() = route.hash;
    layout.fill(
        index, route.positions.positions,
        [&](std::uint32_t frame) { return std::span<const float>(route.features.col(frame).data(), dimension); },
        own_chunk_);
    node_.publish(own_chunk_);
  }
}

void EncoderService::on_positions(const msg::TraversalChunk& chunk) {
  const auto found = routes_.find(chunk.hash());
  if (found == routes_.end() || chunk.feature_dimension() != 0) return;
  if (found->second->positions.take(chunk) == Transfer::Taken::kDamaged) ++node_.traffic.rejected;
}

void EncoderService::on_image(const msg::ImageChunk& chunk) {
  const auto found = routes_.find(chunk.hash());
  if (found == routes_.end()) return;
  Route& route = *found->second;
  std::vector<FetchedImage> images;
  route.images.on_chunk(chunk, images);
  for (const FetchedImage& image : images) route.bytes += image.file.size();
  auto& waiting = learned_ ? waiting_[route.hash] : lessons_;
  std::move(images.begin(), images.end(), std::back_inserter(waiting));
}

void EncoderService::on_status(const msg::ServiceStatus& status) {
  if (const auto found = environments_.find(status.header().sender().c_str()); found != environments_.end())
    if (found->second.info.header().incarnation() == status.header().incarnation()) found->second.presence.heard(now_);
  if (std::string(status.service().c_str()) != "encoder_service") return;
  if (status.service_state() == msg::STOPPING)
    peers_.erase(status.header().incarnation());
  else
    peers_[status.header().incarnation()] = {Presence(now_), true};
}

// ------------------------------------------------------------------------------------------------ what is done

Route* EncoderService::reference() {
  for (const auto& [hash, route] : routes_)
    if (route->name == options_.reference && (host(*route) || route->ready)) return route.get();
  return nullptr;
}

const Environment* EncoderService::host(const Route& route) const {
  for (const auto& [id, environment] : environments_)
    if (environment.info.hash() == route.hash && alive(environment)) return &environment;
  return nullptr;
}

std::string EncoderService::learned_path(const std::string& what, const std::string& suffix) const {
  return fmt::format("{}/{:016x}.{}", options_.store, hash_of(what), suffix);
}

/// What features are made by: the same words, the same features.
std::string EncoderService::recipe_of_features() const {
  const std::string reduction = options_.reduction_file.empty()
                                    ? fmt::format("{} {} {:g}", options_.reduction.dimension,
                                                  name_of(options_.reduction.centring), options_.reduction.whitening)
                                    : std::filesystem::path(options_.reduction_file).filename().string();
  return (spec_.name + " | " + reduction).substr(0, 256);
}

void EncoderService::learn_encoder() {
  Route* route = reference();
  if (learning_ || !route) return;
  const int wanted = std::min(encoder_->lessons(), route->frames);
  const std::string path = learned_path(fmt::format("{} {:016x}", recipe_, route->hash), "encoder");
  if (!options_.store.empty() && std::filesystem::exists(path)) {
    const std::string state = read_file(path);
    try {
      encoder_->restore(std::as_bytes(std::span(state)));
      learned_ = true;
      spec_ = encoder_->spec();
      spdlog::info("encoder {}: {} numbers a picture, learned before ({})", spec_.name, spec_.dimension, path);
      return;
    } catch (const Error& error) {
      spdlog::warn("{}: {}; learning anew", path, error.what());
    }
  }
  learning_ = true;
  std::vector<int> frames;
  for (int i = 0; i < wanted; ++i)
    frames.push_back(static_cast<int>((2 * std::int64_t{i} + 1) * route->frames / (2 * std::int64_t{wanted})));
  spdlog::info("encoder {} learns from {} of {} frames of {}", options_.encoder, wanted, route->frames, route->name);
  route->images.want(frames);
}

void EncoderService::finish_lessons() {
  Route* route = reference();
  if (!learning_ || learned_ || !route || route->images.missing() > 0 || lessons_.empty()) return;
  auto images = std::make_shared<std::vector<FetchedImage>>(std::move(lessons_));
  lessons_.clear();
  route->bytes = 0;
  const std::uint64_t hash = route->hash;
  encoding_.post(
      [this, images] {
        std::vector<cv::Mat> pictures;
        for (const FetchedImage& image : *images) {
          try {
            if (!image.file.empty()) pictures.push_back(decode_picture(image.file, image.name));
          } catch (const Error& error) {
            spdlog::warn("{}", error.what());
          }
        }
        if (pictures.empty()) throw Error("not one picture could be read", "reference '" + options_.reference + "'");
        encoder_->learn(pictures);
      },
      [this, hash] {
        learned_ = true;
        spec_ = encoder_->spec();
        spdlog::info("encoder {}: {} numbers a picture", spec_.name, spec_.dimension);
        if (options_.store.empty()) return;
        const Bytes state = encoder_->state();
        write_file(learned_path(fmt::format("{} {:016x}", recipe_, hash), "encoder"),
                   {reinterpret_cast<const char*>(state.data()), state.size()});
      });
}

void EncoderService::advance() {
  if (!learned_) {
    learn_encoder();
    finish_lessons();
    if (!learned_) return;
  }
  if (!reduction_ && !options_.reduction_file.empty()) {
    const std::string bytes = read_file(options_.reduction_file);
    reduction_ = std::make_shared<Reduction>(
        Reduction::load(std::as_bytes(std::span(bytes)), spec_.name, options_.reduction_file));
  }
  feed();
  for (const auto& [hash, route] : routes_)
    if (route->work && !route->reducing && !route->ready && route->fault.empty() && route->work->complete())
      reduce(*route);
}

void EncoderService::feed() {
  std::vector<Route*> order;
  for (const auto& [hash, route] : routes_)
    if (!route->ready && !route->reducing && route->fault.empty() && host(*route)) order.push_back(route.get());
  // What others wait for comes first.
  std::stable_partition(order.begin(), order.end(), [this](Route* route) { return route->name == options_.reference; });
  int ahead = 0;
  for (Route* route : order)
    ahead += route->images.missing() + route->behind + static_cast<int>(waiting_[route->hash].size());
  for (Route* route : order) {
    if (!route->work) {
      FeatureStore::Key key{spec_.name, spec_.dimension, route->hash, route->frames};
      route->work = std::make_unique<TraversalWork>(options_.store, key);
      route->since = now_;
      route->next_word = now_ + kProgress;
      if (route->work->done() > 0)
        spdlog::info("{}: {} of {} frames were encoded before", route->name, route->work->done(), route->frames);
    }
    // Enough pictures on their way that neither the wire nor the processor waits for the other.
    while (!route->work->complete() && ahead < TraversalWork::kBlock + 2 * spec_.batch) {
      // Several services begin at different places.
      const auto begin = static_cast<int>(mix_seeds({node_.incarnation()}) % static_cast<std::uint64_t>(route->frames));
      const auto frames = route->work->reserve(peers_.empty() ? 0 : begin);
      if (!frames) break;
      route->images.want(*frames);
      ahead += static_cast<int>(frames->size());
    }
    flush(*route, route->images.missing() == 0);
    if (now_ >= route->next_word && !route->work->complete()) {
      route->next_word = now_ + kProgress;
      const double elapsed = std::chrono::duration<double>(now_ - route->since).count();
      const int left = route->frames - route->work->done();
      if (route->work->made() > 0)
        spdlog::info("{}: {} of {} frames encoded, {} left", route->name, route->work->done(), route->frames,
                     duration(elapsed / route->work->made() * left));
    }
  }
}

void EncoderService::flush(Route& route, bool all) {
  std::vector<FetchedImage>& waiting = waiting_[route.hash];
  while (!waiting.empty() && (all || static_cast<int>(waiting.size()) >= spec_.batch)) {
    auto batch = std::make_shared<Batch>();
    batch->traversal = route.hash;
    const auto count = std::min<std::ptrdiff_t>(spec_.batch, static_cast<std::ptrdiff_t>(waiting.size()));
    std::move(waiting.begin(), waiting.begin() + count, std::back_inserter(batch->images));
    waiting.erase(waiting.begin(), waiting.begin() + count);
    route.behind += static_cast<int>(count);
    encoding_.post(
        [this, batch] {
          std::vector<cv::Mat> pictures;
          for (const FetchedImage& image : batch->images) {
            try {
              if (image.file.empty()) throw Error(image.name);
              pictures.push_back(decode_picture(image.file, image.name));
              batch->frames.push_back(image.frame);
            } catch (const Error& error) {
              batch->faults.emplace_back(image.frame, error.what());
            }
          }
          if (!pictures.empty()) batch->descriptors = encoder_->encode(pictures);
        },
        [this, batch] { encoded(*batch); });
  }
}

void EncoderService::encoded(Batch& batch) {
  Route& route = *routes_.at(batch.traversal);
  route.behind -= static_cast<int>(batch.images.size());
  for (const FetchedImage& image : batch.images) route.bytes -= image.file.size();
  for (std::size_t i = 0; i < batch.frames.size(); ++i)
    route.work->put(batch.frames[i], batch.descriptors.col(static_cast<Eigen::Index>(i)));
  encoded_ += batch.frames.size();
  for (const auto& [frame, why] : batch.faults) {
    spdlog::error("{}, frame {}: {}", route.name, frame, why);
    route.work->put_bad(frame);
    if (!options_.skip_bad_frames && route.fault.empty())
      route.fault = fmt::format("{} is refused: frame {}: {} (--on-bad-frame skip puts its neighbour in its place)",
                                route.name, frame, why);
  }
  if (!route.fault.empty()) spdlog::error("{}", route.fault);
}

void EncoderService::reduce(Route& route) {
  const bool is_reference = route.name == options_.reference;
  if (needs_reference() && !reduction_ && !is_reference) return;  // the reference's turn is first
  if (!route.positions.complete()) return;
  route.reducing = true;
  const double elapsed = std::chrono::duration<double>(now_ - route.since).count();
  spdlog::info("{}: all {} frames encoded ({} of them now, in {:.1f} s)", route.name, route.frames, route.work->made(),
               elapsed);
  auto features = std::make_shared<Eigen::MatrixXf>();
  auto learned = std::make_shared<std::shared_ptr<const Reduction>>(reduction_);
  const std::string path =
      options_.store.empty() || !needs_reference()
          ? ""
          : learned_path(fmt::format("{} {:016x} {} {} {:g}", spec_.name, route.hash, options_.reduction.dimension,
                                     static_cast<int>(options_.reduction.centring), options_.reduction.whitening),
                         "reduction");
  TraversalWork* work = route.work.get();
  reducing_.post(
      [this, work, features, learned, path] {
        const Eigen::MatrixXf descriptors = work->take_descriptors();
        if (!*learned && !path.empty() && std::filesystem::exists(path)) {
          const std::string bytes = read_file(path);
          try {
            *learned = std::make_shared<Reduction>(Reduction::load(std::as_bytes(std::span(bytes)), spec_.name, path));
          } catch (const Error& error) {
            spdlog::warn("{}; learning it anew", error.what());
          }
        }
        if (!*learned) {
          *learned = std::make_shared<Reduction>(Reduction::learn(descriptors, options_.reduction));
          if (!path.empty()) {
            const Bytes bytes = (*learned)->save(spec_.name);
            write_file(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
            spdlog::info("the reduction is kept in {}", path);
          }
        }
        *features = (*learned)->apply(descriptors);
      },
      [this, &route, features, learned] {
        if (needs_reference()) reduction_ = *learned;
        route.features = std::move(*features);
        route.work.reset();
        route.reducing = false;
        route.ready = true;
        spdlog::info("{}: ready, {} features a frame", route.name, route.features.rows());
      });
}

void EncoderService::ask() {
  for (const auto& [hash, route] : routes_) {
    const Environment* environment = host(*route);
    if (!environment || route->ready) continue;
    const std::string id = environment->info.header().sender().c_str();
    if (!learned_ || route->bytes < kBytesAhead) route->images.ask(id);
    if (!route->positions.ask(now_, own_request_)) continue;
    own_request_.environment() = id.c_str();
    node_.publish(own_request_);
  }
}

/// Each env_service is served by one encoder_service: the one that serves it already, as long as it lives; else, of
/// those that live, the one that the hash of both ids favours, so that several divide many env_services; else, when
/// that one has not begun, whoever is ready.
void EncoderService::decide_who_serves() {
  for (auto peer = peers_.begin(); peer != peers_.end();)
    peer = peer->second.presence.here(now_) ? std::next(peer) : peers_.erase(peer);
  for (auto& [id, environment] : environments_) {
    if (environment.server != 0 && (serving(environment) || peers_.count(environment.server))) continue;
    if (environment.server != 0) {
      spdlog::warn("the encoder_service of '{}' went silent", id);
      environment.server = 0;
      environment.unserved = now_;
    }
    const auto route = routes_.find(environment.info.hash());
    if (!alive(environment) || route == routes_.end() || !route->second->ready || !environment.fault.empty()) continue;
    const std::uint64_t environment_hash = hash_of(id);
    const std::uint64_t own = mix_seeds({environment_hash, node_.incarnation()});
    bool favoured = true;
    for (const auto& [incarnation, peer] : peers_) favoured &= own > mix_seeds({environment_hash, incarnation});
    if (!favoured && now_ < environment.unserved + kSilence) continue;
    const auto dimension = static_cast<std::uint64_t>(route->second->features.rows());
    if (dimension > msg::MAX_DIMENSION) {
      environment.fault =
          fmt::format("{} features a frame are too many for '{}' (at most {}): give a smaller --dimension", dimension,
                      id, msg::MAX_DIMENSION);
      spdlog::error("{}", environment.fault);
      continue;
    }
    environment.server = node_.incarnation();
    spdlog::info("serves '{}'", id);
    send_info(environment);
  }
}

/// Once all env_services have their features themselves, or observe by reference, their observations are no business of
/// ours; thousands a second would cost them and us time.
void EncoderService::listen_when_needed() {
  const bool needed =
      environments_.empty() || std::any_of(environments_.begin(), environments_.end(), [this](const auto& entry) {
        const msg::TraversalInfo& info = entry.second.info;
        return alive(entry.second) && info.feature_dimension() == 0 && !info.by_reference();
      });
  if (needed == listening_) return;
  listening_ = needed;
  if (needed)
    node_.create_reader<msg::Observation>();
  else
    node_.delete_reader<msg::Observation>();
}

void EncoderService::send_info(const Environment& environment) {
  msg::TraversalInfo info = environment.info;
  const Route& route = *routes_.at(info.hash());
  info.feature_dimension() = static_cast<std::uint32_t>(route.features.rows());
  info.chunks() = ChunkLayout(info.frames(), info.feature_dimension()).chunks();
  info.encoder() = recipe_of_features().c_str();
  info.encoder_service() = node_.options().id.c_str();
  info.encoder_incarnation() = node_.incarnation();
  node_.forward(info);
}

bool EncoderService::busy() const {
  for (const auto& [hash, route] : routes_)
    if (!route->ready && route->fault.empty()) return true;
  return false;
}

void EncoderService::report() {
  next_report_ = now_ + seconds(1);
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
  for (const auto& [hash, route] : routes_) {
    if (!route->fault.empty()) {
      state = msg::FAILED;
      activity = route->fault;
      break;
    }
    if (!host(*route) || route->ready || !activity.empty()) continue;
    state = msg::RUNNING;
    if (route->work) {
      const double elapsed = std::chrono::duration<double>(now_ - route->since).count();
      const int left = route->frames - route->work->done();
      activity = fmt::format("{}: {} of {} frames encoded", route->name, route->work->done(), route->frames);
      if (route->work->made() > 0 && left > 0)
        activity += ", " + duration(elapsed / route->work->made() * left) + " left";
      if (left == 0 && needs_reference() && !reduction_ && !reference()) {
        state = msg::WAITING;
        activity = fmt::format("{} waits for an env_service on the reference '{}'", route->name, options_.reference);
      }
    } else if (learning_) {
      activity = "learning from " + options_.reference;
    } else {
      state = msg::WAITING;
      activity = fmt::format("{} waits for an env_service on the reference '{}'", route->name, options_.reference);
    }
  }
  if (activity.empty() && served > 0) {
    state = msg::RUNNING;
    activity = fmt::format("completes the observations of {} env_service{}", served, served == 1 ? "" : "s");
  }
  if (activity.empty()) activity = routes_.empty() ? "waiting for an env_service with images" : "ready; others serve";
  node_.report(state, activity, static_cast<float>(encoded_ - reported_));
  reported_ = encoded_;
}

}  // namespace

void run_encoder_service(const EncoderServiceOptions& options, const std::function<bool()>& stop) {
  EncoderService(options).run(stop);
}

}  // namespace citylearn
