// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/env_client.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

constexpr auto kSettingsAgain = std::chrono::milliseconds(100);
constexpr auto kAcknowledgementsAgain = std::chrono::seconds(1);

Error did_not_come(const RouteFeatures& route, const Seat& seat) {
  return Error(std::to_string(route.transfer.missing()) + " chunks of its features did not come",
               "traversal '" + seat.traversal() + "'", "is env_service '" + seat.id + "' still running?");
}

bool same(const msg::SettingsId& a, const msg::SettingsId& b) {
  return a.incarnation() == b.incarnation() && a.version() == b.version();
}

/// What a process says of itself for good.
bool same_traversal(const msg::TraversalInfo& a, const msg::TraversalInfo& b) {
  return a.hash() == b.hash() && a.frames() == b.frames() && a.agents() == b.agents() &&
         a.traversal() == b.traversal() && a.images() == b.images();
}

/// Why no env_service with these settings can have sent it; empty when one can.
std::string nonsense(const Seat& seat, const msg::Observation& observation) {
  const msg::TaskSettings& settings = seat.settings;
  const auto beside = [&](const std::vector<std::uint32_t>& frames) {
    return std::any_of(frames.begin(), frames.end(), [&](std::uint32_t frame) {
      return frame < settings.first_frame() || frame - settings.first_frame() >= settings.frames();
    });
  };
  if (observation.goal().size() != seat.info.agents()) return "of another number of agents";
  if (beside(observation.position())) return "with a position beside the route";
  if (beside(observation.goal())) return "with a goal beside the route";
  if (beside(observation.frame())) return "with a frame beside the route";
  for (const std::uint8_t allowed : observation.allowed())
    if ((allowed & ((1u << kActions) - 1)) == 0) return "that allows no action";
  return "";
}

}  // namespace

Fleet::Fleet(Node& node, const FleetOptions& options)
    : node_(node), options_(options), rejections_(node), features_(node) {
  node_.create_writer<msg::TaskSettings>();
  node_.create_writer<msg::Action>();
  node_.create_writer<msg::TraversalRequest>();
  node_.create_writer<msg::EpisodeAcknowledgement>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::Observation>();
  node_.create_reader<msg::EpisodeStat>();
  node_.create_reader<msg::TraversalChunk>();
  node_.create_reader<msg::ServiceStatus>();
}

bool Fleet::alive(const Seat& seat) { return seat.presence.here(Clock::now()); }

Seat* Fleet::known(const msg::Header& header) {
  const auto found = seats_.find(header.sender().c_str());
  if (found == seats_.end() || found->second->incarnation() != header.incarnation()) return nullptr;
  found->second->presence.heard(Clock::now());
  return found->second.get();
}

/// As known(), of messages that only the newest process of an env_service sends. An older one is dead; a newer one
/// would have announced itself.
Seat* Fleet::speaking(const msg::Header& header) {
  if (Seat* seat = known(header)) return seat;
  const auto found = seats_.find(header.sender().c_str());
  if (found == seats_.end() || header.incarnation() < found->second->incarnation())
    ++node_.traffic.repeated;
  else
    rejections_.add(header, "a message of another process than the one that announced itself");
  return nullptr;
}

/// Of an env_service, or of the encoder_service that completed its announcement.
bool Fleet::serves_features(const msg::Header& header) const {
  return std::any_of(seats_.begin(), seats_.end(), [&](const auto& entry) {
    const msg::TraversalInfo& info = entry.second->info;
    return (header.sender() == info.header().sender() && header.incarnation() == info.header().incarnation()) ||
           (header.sender() == info.encoder_service() && header.incarnation() == info.encoder_incarnation());
  });
}

void Fleet::spin(Clock::time_point deadline) {
  ask_for_features();
  send_due_settings();
  // Settings and requests are re-sent by this loop, so it never sleeps past their time.
  node_.wait(std::min(deadline, Clock::now() + std::chrono::milliseconds(50)));
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(chunk_))
    if (!features_.take(chunk_, serves_features(chunk_.header())))
      rejections_.add(chunk_.header(), "features that are damaged, or of who does not have them");
  while (hears_observations_ && node_.take(observation_)) on_observation(observation_);
  while (hears_episodes_ && node_.take(episode_))
    if (Seat* seat = speaking(episode_.header()); seat && finished) finished(*seat, episode_);
  if (!records_ || Clock::now() < next_acknowledgements_) return;
  next_acknowledgements_ = Clock::now() + kAcknowledgementsAgain;
  for (const auto& [id, seat] : seats_)
    if (alive(*seat)) send_acknowledgement(*seat, false);
}

void Fleet::on_status(const msg::ServiceStatus& status) {
  if (Seat* seat = known(status.header())) seat->busy = status.service_state() == msg::RUNNING;
  const std::string id = status.header().sender().c_str();
  if (const auto found = unencoded_.find(id); found != unencoded_.end()) found->second.presence.heard(Clock::now());
  if (std::string(status.service().c_str()) != "encoder_service") return;
  beats_[status.header().incarnation()].heard(Clock::now());
  encoders_[id] = {{id + ": " + status.activity().c_str(), status.service_state() == msg::RUNNING},
                   Presence(Clock::now())};
}

std::map<std::string, std::string> Fleet::unencoded() const {
  std::map<std::string, std::string> found;
  for (const auto& [id, traversal] : unencoded_)
    if (traversal.presence.here(Clock::now())) found[id] = traversal.what;
  return found;
}

std::vector<Fleet::Encoder> Fleet::encoders() const {
  std::vector<Encoder> found;
  for (const auto& [id, encoder] : encoders_)
    if (encoder.presence.here(Clock::now())) found.push_back(encoder.what);
  return found;
}

void Fleet::on_info(const msg::TraversalInfo& info) {
  if (info.images() && info.feature_dimension() == 0) {  // an encoder_service will send it again, complete
    if (!known(info.header()))
      unencoded_[info.header().sender().c_str()] = {info.traversal().c_str(), Presence(Clock::now())};
    return;
  }
  unencoded_.erase(info.header().sender().c_str());
  std::unique_ptr<Seat>& slot = seats_[info.header().sender().c_str()];
  // Of a process that is dead, kept by the middleware for late joiners; unless it is the newer one that went away (an
  // env_service ends when it finds another one with its id).
  if (slot && slot->incarnation() > info.header().incarnation() && alive(*slot)) {
    ++node_.traffic.repeated;
    return;
  }
  const bool fresh = !slot || slot->incarnation() != info.header().incarnation();
  if (!fresh && !same_traversal(info, slot->info)) {
    rejections_.add(info.header(), "an announcement that differs from what this process said before");
    return;
  }
  if (!slot) slot = std::make_unique<Seat>();
  Seat& seat = *slot;
  seat.presence.heard(Clock::now());
  // An env_service that got its features from an encoder_service announces them itself, but not who made them.
  const std::string encoder = !fresh && info.images() ? seat.info.encoder().c_str() : "";
  seat.info = info;
  if (seat.info.encoder().size() == 0) seat.info.encoder() = encoder.c_str();
  if (fresh) {
    spdlog::info("{} '{}' joins: traversal {} of {}, {} frames x {} features, {} agents",
                 seat.settings.settings().version() == 0 ? "env_service" : "restarted env_service",
                 info.header().sender().c_str(), info.traversal().c_str(), info.dataset().c_str(), info.frames(),
                 info.feature_dimension(), info.agents());
    seat.id = info.header().sender().c_str();
    seat.settings = msg::TaskSettings();
    seat.in_force = seat.waiting = seat.busy = false;
    seat.heard_charge = info.settings().incarnation();
    seat.features.reset();
    seat.acknowledged = 0;
    if (records_) send_acknowledgement(seat, false);
    if (joined) joined(seat);
  } else if (same(info.settings(), seat.settings.settings())) {
    seat.in_force = true;
  }
  seat.heard_charge = std::max<std::uint64_t>(seat.heard_charge, info.settings().incarnation());
}

void Fleet::on_observation(msg::Observation& observation) {
  Seat* seat = speaking(observation.header());
  if (!seat) return;
  seat->heard_charge = std::max<std::uint64_t>(seat->heard_charge, observation.settings().incarnation());
  // Images: what counts is the same observation with features.
  if (!observation.by_reference() && observation.feature_dimension() != seat->info.feature_dimension()) return;
  if (seat->settings.settings().version() == 0 || !same(observation.settings(), seat->settings.settings())) {
    ++node_.traffic.repeated;
    return;
  }
  seat->in_force = true;
  if (observation.step() + 1 == seat->next_step) {  // our answer was lost, or crossed this repetition
    ++node_.traffic.repeated;
    ++node_.traffic.resent;
    node_.publish(seat->last_action);
    return;
  }
  if (observation.step() != seat->next_step || seat->waiting) {
    ++node_.traffic.repeated;
    return;
  }
  std::string wrong = nonsense(*seat, observation);
  if (wrong.empty() && observation.by_reference() && !complete(*seat, observation))
    wrong = "of frames without features";
  if (!wrong.empty()) {
    rejections_.add(observation.header(), "an observation " + wrong);
    seat->presence.forget();  // nobody need wait for it
    return;
  }
  seat->waiting = true;
  if (decide && decide(*seat, observation, choice_)) answer(*seat, choice_);
}

/// Looks up what the env_service left out.
bool Fleet::complete(const Seat& seat, msg::Observation& observation) {
  if (!seat.features) return false;
  const std::size_t dimension = seat.features->dimension();
  observation.features().resize(observation.frame().size() * dimension);
  float* to = observation.features().data();
  for (const std::uint32_t frame : observation.frame()) {
    const float* from = seat.features->at(frame);
    if (!from) return false;
    to = std::copy_n(from, dimension, to);
  }
  observation.by_reference() = false;
  observation.feature_dimension() = static_cast<std::uint32_t>(dimension);
  return true;
}

bool Fleet::by_reference(const Seat& seat) const {
  const std::size_t numbers = std::size_t{seat.info.agents()} * seat.info.feature_dimension();
  if (options_.observing == Observing::kWhole && numbers > msg::MAX_FEATURES)
    throw Error("the features of " + std::to_string(seat.info.agents()) + " agents x " +
                    std::to_string(seat.info.feature_dimension()) + " do not fit one observation (at most " +
                    std::to_string(msg::MAX_FEATURES) + ")",
                "env_service '" + seat.id + "'", "ask for observations by reference");
  return options_.observing == Observing::kByReference
             ? numbers > 0
             : options_.observing == Observing::kAsFits && numbers * sizeof(float) > kLargestWhole;
}

void Fleet::answer(Seat& seat, const std::vector<std::uint8_t>& choice) {
  msg::Action& action = seat.last_action;
  action.environment() = seat.id.c_str();
  action.environment_incarnation() = seat.incarnation();
  action.settings() = seat.settings.settings();
  action.step() = seat.next_step;
  action.choice() = choice;
  seat.waiting = false;
  ++seat.next_step;
  node_.publish(action);
}

void Fleet::command(Seat& seat, msg::TaskSettings settings) {
  settings.environment() = seat.id.c_str();
  settings.settings().incarnation() = seat.charge > 0 ? seat.charge : node_.incarnation();
  settings.settings().version() = ++version_;
  settings.by_reference() = settings.task_mode() != msg::IDLE && by_reference(seat);
  // Only then is what was used before let go, or it would be fetched again.
  const auto before = std::exchange(
      seat.features,
      settings.by_reference() ? features_.want(seat.info, settings.first_frame(), settings.frames()) : nullptr);
  seat.settings = settings;
  seat.in_force = seat.waiting = false;
  seat.next_step = 0;
  seat.next_settings = Clock::now();
  send_due_settings();
}

/// Whether whoever has the features of a seat's traversal lives: its env_service, or the encoder_service that serves
/// it.
bool Fleet::answers_requests(const Seat& seat) const {
  if (!alive(seat)) return false;
  const std::uint64_t encoder = seat.info.encoder_incarnation();
  const auto beat = beats_.find(encoder);
  return encoder == 0 || (beat != beats_.end() && beat->second.here(Clock::now()));
}

void Fleet::ask_for_features() {
  for (const auto& [id, seat] : seats_) {
    if (!seat->features || seat->features->complete()) continue;
    RouteFeatures& route = *seat->features;
    if (!answers_requests(*seat)) {
      route.moved = Clock::now();  // it may come back
    } else if (Clock::now() - route.moved > options_.patience) {
      throw did_not_come(route, *seat);
    }
    features_.ask(route, id);
  }
}

void Fleet::take_charge(Seat& seat) {
  // The time, as incarnations are; clocks of hosts differ, so never less than what is known.
  seat.charge = std::max({microseconds_since_epoch(), seat.heard_charge + 1, seat.charge + 1});
}

void Fleet::let_go(Seat& seat) {
  seat.settings = msg::TaskSettings();
  seat.in_force = seat.waiting = false;
  seat.features.reset();
}

void Fleet::hear(bool observations, bool episodes) {
  hears_observations_ = observations;
  hears_episodes_ = episodes;
  observations ? node_.create_reader<msg::Observation>() : node_.delete_reader<msg::Observation>();
  episodes ? node_.create_reader<msg::EpisodeStat>() : node_.delete_reader<msg::EpisodeStat>();
}

void Fleet::send_due_settings() {
  const Clock::time_point now = Clock::now();
  for (const auto& [id, seat] : seats_) {
    if (seat->in_force || seat->settings.settings().version() == 0 || now < seat->next_settings) continue;
    if (lost(*seat)) {
      let_go(*seat);
      continue;
    }
    if (seat->features && !seat->features->complete()) continue;
    node_.publish(seat->settings);
    seat->next_settings = now + kSettingsAgain;
  }
}

void Fleet::acknowledge(Seat& seat, std::uint64_t episode) {
  seat.acknowledged = episode;
  send_acknowledgement(seat, false);
}

void Fleet::send_acknowledgement(const Seat& seat, bool leaving) {
  msg::EpisodeAcknowledgement acknowledgement;
  acknowledgement.environment() = seat.id.c_str();
  acknowledgement.environment_incarnation() = seat.incarnation();
  acknowledgement.episode() = seat.acknowledged;
  acknowledgement.leaving() = leaving;
  node_.publish(acknowledgement);
}

void Fleet::begin_recording() {
  records_ = true;
  for (const auto& [id, seat] : seats_) acknowledge(*seat, 0);
}

void Fleet::end_recording() {
  records_ = false;
  for (const auto& [id, seat] : seats_) send_acknowledgement(*seat, true);
}

std::vector<float> Fleet::fetch_features(Seat& seat, int first, int count, Clock::time_point deadline) {
  const auto route =
      features_.want(seat.info, static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(std::max(count, 0)));
  while (!route->complete()) {
    const Clock::time_point now = Clock::now();
    if (now >= deadline) throw did_not_come(*route, seat);
    features_.ask(*route, seat.id);
    spin(std::min(deadline, std::max(now, route->transfer.due())));
  }
  // What the cache keeps may be more than was asked for.
  const float* begin = route->at(static_cast<std::uint32_t>(first));
  return {begin, begin + static_cast<std::size_t>(count) * route->dimension()};
}

}  // namespace citylearn
