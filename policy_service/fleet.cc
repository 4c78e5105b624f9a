#include "policy_service/fleet.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstring>

namespace citylearn {
namespace {

constexpr auto kSettingsAgain = std::chrono::milliseconds(100);
constexpr auto kRequestAgain = std::chrono::milliseconds(200);

bool same(const msg::SettingsId& a, const msg::SettingsId& b) {
  return a.incarnation() == b.incarnation() && a.version() == b.version();
}

}  // namespace

Fleet::Fleet(Node& node) : node_(node) {
  node_.announce<msg::TaskSettings>();
  node_.announce<msg::Action>();
  node_.announce<msg::TraversalRequest>();
  node_.announce<msg::EpisodeAcknowledgement>();
  node_.listen<msg::TraversalInfo>();
  node_.listen<msg::Observation>();
  node_.listen<msg::EpisodeStat>();
  node_.listen<msg::TraversalChunk>();
  node_.listen<msg::ServiceStatus>();
}

bool Fleet::alive(const Seat& seat) { return Clock::now() - seat.heard < kSilence; }

Seat* Fleet::known(const msg::Header& header) {
  const auto found = seats_.find(header.sender().c_str());
  if (found == seats_.end() || found->second->incarnation() != header.incarnation()) return nullptr;
  found->second->heard = Clock::now();
  return found->second.get();
}

void Fleet::spin(Clock::time_point deadline) {
  send_due_settings();
  // Settings and requests are re-sent by this loop, so it never sleeps past their time.
  node_.wait(std::min(deadline, Clock::now() + std::chrono::milliseconds(50)));
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(chunk_)) on_chunk(chunk_);
  while (hears_observations_ && node_.take(observation_)) on_observation(observation_);
  while (hears_episodes_ && node_.take(episode_))
    if (Seat* seat = known(episode_.header()); seat && finished) finished(*seat, episode_);
}

void Fleet::on_status(const msg::ServiceStatus& status) {
  if (Seat* seat = known(status.header())) seat->busy = status.service_state() == msg::RUNNING;
  const std::string id = status.header().sender().c_str();
  if (const auto found = unencoded_.find(id); found != unencoded_.end()) found->second.when = Clock::now();
  if (std::string(status.service().c_str()) == "encoder_service")
    encoders_[id] = {{id + ": " + status.activity().c_str(), status.service_state() == msg::RUNNING}, Clock::now()};
}

std::map<std::string, std::string> Fleet::unencoded() const {
  std::map<std::string, std::string> found;
  for (const auto& [id, traversal] : unencoded_)
    if (Clock::now() - traversal.when < kSilence) found[id] = traversal.what;
  return found;
}

std::vector<Fleet::Encoder> Fleet::encoders() const {
  std::vector<Encoder> found;
  for (const auto& [id, encoder] : encoders_)
    if (Clock::now() - encoder.when < kSilence) found.push_back(encoder.what);
  return found;
}

void Fleet::on_info(const msg::TraversalInfo& info) {
  if (info.images() && info.feature_dimension() == 0) {  // an encoder_service will send it again, complete
    if (!known(info.header())) unencoded_[info.header().sender().c_str()] = {info.traversal().c_str(), Clock::now()};
    return;
  }
  unencoded_.erase(info.header().sender().c_str());
  std::unique_ptr<Seat>& slot = seats_[info.header().sender().c_str()];
  // Of a process that is dead, kept by the middleware for late joiners; unless it is the newer one that went away (an
  // env_service ends when it finds another one with its id).
  if (slot && slot->incarnation() > info.header().incarnation() && alive(*slot)) return;
  const bool fresh = !slot || slot->incarnation() != info.header().incarnation();
  if (!slot) slot = std::make_unique<Seat>();
  Seat& seat = *slot;
  seat.heard = Clock::now();
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
    if (joined) joined(seat);
  } else if (same(info.settings(), seat.settings.settings())) {
    seat.in_force = true;
  }
  seat.heard_charge = std::max<std::uint64_t>(seat.heard_charge, info.settings().incarnation());
}

void Fleet::on_observation(const msg::Observation& observation) {
  Seat* seat = known(observation.header());
  if (seat) seat->heard_charge = std::max<std::uint64_t>(seat->heard_charge, observation.settings().incarnation());
  // Images: what counts is the same observation with features.
  if (seat && observation.feature_dimension() != seat->info.feature_dimension()) return;
  if (!seat || seat->settings.settings().version() == 0 || !same(observation.settings(), seat->settings.settings())) {
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
  if (observation.step() != seat->next_step || seat->waiting || observation.goal().size() != seat->info.agents()) {
    ++node_.traffic.repeated;
    return;
  }
  seat->waiting = true;
  if (decide && decide(*seat, observation, choice_)) answer(*seat, choice_);
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
  seat.settings = settings;
  seat.in_force = seat.waiting = false;
  seat.next_step = 0;
  seat.next_settings = Clock::now();
  send_due_settings();
}

void Fleet::take_charge(Seat& seat) {
  // The time, as incarnations are; clocks of hosts differ, so never less than what is known.
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto microseconds = std::chrono::duration_cast<std::chrono::microseconds>(now).count();
  seat.charge = std::max({static_cast<std::uint64_t>(microseconds), seat.heard_charge + 1, seat.charge + 1});
}

void Fleet::let_go(Seat& seat) {
  seat.settings = msg::TaskSettings();
  seat.in_force = seat.waiting = false;
}

void Fleet::hear(bool observations, bool episodes) {
  hears_observations_ = observations;
  hears_episodes_ = episodes;
  observations ? node_.listen<msg::Observation>() : node_.ignore<msg::Observation>();
  episodes ? node_.listen<msg::EpisodeStat>() : node_.ignore<msg::EpisodeStat>();
}

void Fleet::send_due_settings() {
  const Clock::time_point now = Clock::now();
  for (const auto& [id, seat] : seats_) {
    if (seat->in_force || seat->settings.settings().version() == 0 || now < seat->next_settings) continue;
    if (lost(*seat)) {
      let_go(*seat);
      continue;
    }
    node_.publish(seat->settings);
    seat->next_settings = now + kSettingsAgain;
  }
}

void Fleet::acknowledge(const Seat& seat, std::uint64_t episode) {
  msg::EpisodeAcknowledgement acknowledgement;
  acknowledgement.environment() = seat.id.c_str();
  acknowledgement.environment_incarnation() = seat.incarnation();
  acknowledgement.episode() = episode;
  node_.publish(acknowledgement);
}

std::vector<float> Fleet::fetch_features(Seat& seat, int first, int count, Clock::time_point deadline) {
  const int dimension = static_cast<int>(seat.info.feature_dimension());
  const std::string where = "traversal '" + seat.traversal() + "'";
  if (dimension == 0) throw Error("has no features", where, "choose another agent, or a traversal with features");
  if (first < 0 || count < 1 || static_cast<std::uint32_t>(first + count) > seat.info.frames())
    throw Error("has " + std::to_string(seat.info.frames()) + " frames, the route needs frames " +
                    std::to_string(first) + ".." + std::to_string(first + count - 1),
                where, "choose fewer --frames");
  fetch_ = Fetch{};
  fetch_.hash = seat.info.hash();
  fetch_.dimension = dimension;
  fetch_.frames_a_chunk = static_cast<int>(msg::MAX_CHUNK / (4 * (1 + dimension)));
  fetch_.first = first;
  fetch_.count = count;
  fetch_.features.resize(static_cast<std::size_t>(count) * dimension);
  for (int chunk = first / fetch_.frames_a_chunk; chunk <= (first + count - 1) / fetch_.frames_a_chunk; ++chunk)
    fetch_.missing.push_back(static_cast<std::uint32_t>(chunk));
  fetch_.total = static_cast<int>(seat.info.frames());
  Clock::time_point again = Clock::now();
  std::size_t left_of_window = 0;  // how many will be missing when all asked for have come
  while (!fetch_.missing.empty()) {
    const Clock::time_point now = Clock::now();
    if (now >= deadline)
      throw Error(std::to_string(fetch_.missing.size()) + " chunks of its features did not come", where,
                  "is env_service '" + seat.id + "' still running?");
    if (now >= again) {
      msg::TraversalRequest request;
      const std::size_t window = std::min<std::size_t>(fetch_.missing.size(), msg::MAX_CHUNKS_ASKED);
      request.environment() = seat.id.c_str();
      request.hash() = fetch_.hash;
      request.feature_dimension() = static_cast<std::uint32_t>(fetch_.dimension);
      request.chunks().assign(fetch_.missing.begin(), fetch_.missing.begin() + window);
      left_of_window = fetch_.missing.size() - window;
      node_.publish(request);
      again = now + kRequestAgain;
    }
    spin(std::min(deadline, again));
    if (fetch_.missing.size() == left_of_window)
      again = Clock::now();  // the whole window has come: ask for the next at once
  }
  fetch_.hash = 0;
  return std::move(fetch_.features);
}

void Fleet::on_chunk(const msg::TraversalChunk& chunk) {
  const auto wanted = std::find(fetch_.missing.begin(), fetch_.missing.end(), chunk.chunk());
  if (chunk.hash() != fetch_.hash || static_cast<int>(chunk.feature_dimension()) != fetch_.dimension ||
      wanted == fetch_.missing.end())
    return;
  const std::size_t width = 1 + static_cast<std::size_t>(fetch_.dimension);
  const int start = static_cast<int>(chunk.chunk()) * fetch_.frames_a_chunk;
  if (static_cast<int>(chunk.first_frame()) != start ||
      static_cast<int>(chunk.frames()) != std::min(fetch_.frames_a_chunk, fetch_.total - start) ||
      chunk.data().size() != chunk.frames() * width * sizeof(float)) {
    ++node_.traffic.rejected;
    return;
  }
  for (std::uint32_t i = 0; i < chunk.frames(); ++i) {
    const int place = start + static_cast<int>(i) - fetch_.first;
    if (place < 0 || place >= fetch_.count) continue;
    std::memcpy(fetch_.features.data() + static_cast<std::size_t>(place) * fetch_.dimension,
                chunk.data().data() + (i * width + 1) * sizeof(float), fetch_.dimension * sizeof(float));
  }
  fetch_.missing.erase(wanted);
}

}  // namespace citylearn
