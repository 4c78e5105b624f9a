#include "env_service/env_service.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <map>

#include "env_service/environment.h"

namespace citylearn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kSlice{50};  // the longest wait: stop and timers are looked at this often
constexpr milliseconds kObservationAgain{50}, kObservationSlowest{1000};
constexpr milliseconds kEpisodesAgain{200}, kEpisodesSlowest{2000};
constexpr milliseconds kSilence{3000};  // without an answer for so long, the policy_service counts as away
constexpr std::size_t kEpisodesAtOnce = 64;

bool same(const msg::SettingsId& a, const msg::SettingsId& b) {
  return a.incarnation() == b.incarnation() && a.version() == b.version();
}

/// A time to do something again, later each time.
struct Repetition {
  milliseconds first, slowest;
  milliseconds pause = first;
  Clock::time_point next = Clock::time_point::max();

  void start() { pause = first, next = Clock::now() + pause; }
  void stop() { next = Clock::time_point::max(); }
  bool due() {
    if (Clock::now() < next) return false;
    pause = std::min(2 * pause, slowest);
    next = Clock::now() + pause;
    return true;
  }
};

class EnvService {
 public:
  EnvService(const EnvServiceOptions& options, const Traversal& traversal);
  void run(const std::function<bool()>& stop);

 private:
  void announce_traversal();
  void on_settings(const msg::TaskSettings& settings);
  void on_action(const msg::Action& action);
  void on_request(const msg::TraversalRequest& request);
  void on_acknowledgement(const msg::EpisodeAcknowledgement& acknowledgement);
  void on_status(const msg::ServiceStatus& status);
  void take_everything();
  void repeat_what_is_due();
  void send_observation();
  void send_episodes();
  void tell_state();
  bool mine(const auto& message) const { return options_.node.id == message.environment().c_str(); }

  EnvServiceOptions options_;
  Environment environment_;
  Node node_;
  int frames_a_chunk_;
  msg::TraversalInfo info_;
  msg::Observation observation_;
  msg::SettingsId in_force_;
  msg::SettingsId refused_;
  msg::Mode mode_ = msg::IDLE;
  bool answered_ = true;       ///< no observation waits for its action
  std::uint64_t episode_ = 0;  ///< number of the last finished one
  std::uint64_t acknowledged_ = 0;
  std::deque<msg::EpisodeStat> unacknowledged_;
  Repetition observation_again_{kObservationAgain, kObservationSlowest};
  Repetition episodes_again_{kEpisodesAgain, kEpisodesSlowest};
  Repetition info_again_{milliseconds(1000), milliseconds(1000)};
  Clock::time_point heard_ = Clock::now();  ///< last word of a policy_service
  Clock::time_point rate_since_ = Clock::now();
  std::uint64_t ticks_ = 0, ticks_before_ = 0;
  std::map<std::uint64_t, int> predecessor_beats_;  ///< heartbeats heard of older processes with our id, by incarnation
  msg::TaskSettings settings_;
  msg::Action action_;
  msg::TraversalRequest request_;
  msg::EpisodeAcknowledgement acknowledgement_;
  msg::ServiceStatus status_;
};

EnvServiceOptions named(EnvServiceOptions options, const Traversal& traversal) {
  if (options.node.id.empty()) options.node.id = ("env-" + traversal.name).substr(0, 64);
  options.node.service = "env_service";
  return options;
}

EnvService::EnvService(const EnvServiceOptions& options, const Traversal& traversal)
    : options_(named(options, traversal)),
      environment_(traversal, options.agents),
      node_(options_.node),
      frames_a_chunk_(static_cast<int>(msg::MAX_CHUNK / (4 * (1 + static_cast<std::uint32_t>(traversal.dimension))))) {
  for (const auto& [what, text] : {std::pair{"traversal's name", traversal.name}, {"condition", traversal.condition}})
    if (text.size() > 64) throw Error("has more than 64 characters: " + text, what, "rename it");
  node_.announce<msg::TraversalInfo>();
  node_.announce<msg::Observation>();
  node_.announce<msg::EpisodeStat>();
  node_.announce<msg::TraversalChunk>();
  node_.listen<msg::TaskSettings>();
  node_.listen<msg::Action>();
  node_.listen<msg::TraversalRequest>();
  node_.listen<msg::EpisodeAcknowledgement>();
  node_.listen<msg::ServiceStatus>();
  info_.dataset() = traversal.dataset.c_str();
  info_.traversal() = traversal.name.c_str();
  info_.condition() = traversal.condition.c_str();
  info_.hash() = environment_.traversal_hash();
  info_.frames() = static_cast<std::uint32_t>(traversal.frames);
  info_.feature_dimension() = static_cast<std::uint32_t>(traversal.dimension);
  info_.agents() = static_cast<std::uint32_t>(environment_.agents());
  info_.chunks() = static_cast<std::uint32_t>((traversal.frames + frames_a_chunk_ - 1) / frames_a_chunk_);
}

void EnvService::run(const std::function<bool()>& stop) {
  spdlog::info("{}: {} agents on '{}' of {}, {} frames x {} features, {}, domain {}", options_.node.id,
               environment_.agents(), info_.traversal().c_str(), info_.dataset().c_str(), info_.frames(),
               info_.feature_dimension(), node_.middleware_name(), options_.node.middleware.domain);
  node_.report(msg::WAITING, "waiting for a policy_service");
  announce_traversal();
  info_again_.start();
  while (!stop()) {
    Clock::time_point until = Clock::now() + kSlice;
    for (const Repetition* each : {&observation_again_, &episodes_again_, &info_again_})
      until = std::min(until, each->next);
    node_.wait(until);
    take_everything();
    repeat_what_is_due();
    tell_state();
  }
  node_.report(msg::STOPPING, "stopping");
  // What is on its way gets a chance to be acknowledged; a recorder that comes later finds a gap it can see.
  const Clock::time_point deadline = Clock::now() + milliseconds(500);
  while (!unacknowledged_.empty() && node_.readers<msg::EpisodeStat>() > 0 && Clock::now() < deadline) {
    node_.wait(Clock::now() + milliseconds(20));
    while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
    if (episodes_again_.due()) send_episodes();
  }
  if (!unacknowledged_.empty())
    spdlog::warn("{} finished episodes were not acknowledged by anybody", unacknowledged_.size());
}

void EnvService::announce_traversal() {
  info_.settings() = in_force_;
  node_.publish(info_);
}

void EnvService::take_everything() {
  while (node_.take(settings_)) on_settings(settings_);
  while (node_.take(action_)) on_action(action_);
  while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  while (node_.take(request_)) on_request(request_);
  while (node_.take(status_)) on_status(status_);
}

void EnvService::repeat_what_is_due() {
  if (!answered_ && observation_again_.due()) {
    ++node_.traffic.resent;
    node_.publish(observation_);
  }
  if (!unacknowledged_.empty() && episodes_again_.due()) send_episodes();
  // Nobody commands: whoever comes must learn that we are here, though the first word may get lost.
  if (info_again_.due() && (in_force_.version() == 0 || mode_ == msg::IDLE || Clock::now() - heard_ > kSilence))
    announce_traversal();
}

void EnvService::on_settings(const msg::TaskSettings& settings) {
  if (!mine(settings)) return;
  heard_ = Clock::now();
  const msg::SettingsId& id = settings.settings();
  if (same(id, in_force_)) {  // our confirmation was lost
    ++node_.traffic.repeated;
    announce_traversal();
    return;
  }
  const bool newer = id.incarnation() > in_force_.incarnation() ||
                     (id.incarnation() == in_force_.incarnation() && id.version() > in_force_.version());
  if (!newer || same(id, refused_)) {
    ++node_.traffic.repeated;
    return;
  }
  if (settings.task_mode() != msg::IDLE) {
    try {
      environment_.reset(settings);
    } catch (const Error& error) {
      refused_ = id;
      spdlog::error("settings of {} refused: {}", settings.header().sender().c_str(), error.what());
      node_.report(msg::FAILED, std::string("settings refused: ") + error.what());
      return;
    }
  }
  in_force_ = id;
  refused_ = msg::SettingsId();
  mode_ = settings.task_mode();
  answered_ = true;
  announce_traversal();
  if (mode_ == msg::IDLE) {
    observation_again_.stop();
  } else {
    send_observation();
  }
}

void EnvService::send_observation() {
  environment_.observe(observation_);
  node_.publish(observation_);
  // An observation in which nobody has a task left needs no answer.
  answered_ = environment_.done();
  if (answered_) {
    observation_again_.stop();
  } else {
    observation_again_.start();
  }
}

void EnvService::on_action(const msg::Action& action) {
  if (!mine(action)) return;
  if (action.environment_incarnation() != node_.incarnation() || !same(action.settings(), in_force_) || answered_ ||
      action.step() != observation_.step()) {
    ++node_.traffic.repeated;
    return;
  }
  heard_ = Clock::now();
  try {
    environment_.step(action.choice());
  } catch (const Error& error) {
    if (++node_.traffic.rejected == 1)
      spdlog::error("action of {} rejected: {}", action.header().sender().c_str(), error.what());
    return;
  }
  ++ticks_;
  for (const Environment::Episode& finished : environment_.finished()) {
    msg::EpisodeStat& stat = unacknowledged_.emplace_back();
    stat.settings() = in_force_;
    stat.episode() = ++episode_;
    stat.acknowledged() = acknowledged_;
    stat.agent() = static_cast<std::uint32_t>(finished.agent);
    stat.evaluation() = mode_ == msg::EVALUATE;
    stat.task() = static_cast<std::uint32_t>(finished.task);
    stat.traversal() = info_.traversal();
    stat.start() = static_cast<std::uint32_t>(finished.start);
    stat.goal() = static_cast<std::uint32_t>(finished.goal);
    stat.steps() = static_cast<std::uint32_t>(finished.steps);
    stat.shortest() = static_cast<std::uint32_t>(finished.shortest);
    stat.reward() = finished.reward;
    stat.completed() = finished.completed;
    if (unacknowledged_.size() == 1) episodes_again_.start();
    node_.publish(stat);
  }
  send_observation();
}

void EnvService::send_episodes() {
  const std::size_t count = std::min(unacknowledged_.size(), kEpisodesAtOnce);
  for (std::size_t i = 0; i < count; ++i) {
    unacknowledged_[i].acknowledged() = acknowledged_;
    ++node_.traffic.resent;
    node_.publish(unacknowledged_[i]);
  }
}

void EnvService::on_acknowledgement(const msg::EpisodeAcknowledgement& acknowledgement) {
  if (!mine(acknowledgement) || acknowledgement.environment_incarnation() != node_.incarnation() ||
      acknowledgement.episode() > episode_) {
    return;
  }
  if (acknowledgement.episode() <= acknowledged_) {
    ++node_.traffic.repeated;
    return;
  }
  acknowledged_ = acknowledgement.episode();
  while (!unacknowledged_.empty() && unacknowledged_.front().episode() <= acknowledged_) unacknowledged_.pop_front();
  episodes_again_.start();
}

void EnvService::on_request(const msg::TraversalRequest& request) {
  if (!mine(request) || request.hash() != info_.hash()) return;
  heard_ = Clock::now();
  const Traversal& traversal = environment_.traversal();
  const std::size_t width = 1 + static_cast<std::size_t>(traversal.dimension);
  msg::TraversalChunk chunk;
  chunk.hash() = info_.hash();
  for (const std::uint32_t index : request.chunks()) {
    if (index >= info_.chunks()) continue;
    const int first = static_cast<int>(index) * frames_a_chunk_;
    const int count = std::min(frames_a_chunk_, traversal.frames - first);
    chunk.chunk() = index;
    chunk.first_frame() = static_cast<std::uint32_t>(first);
    chunk.frames() = static_cast<std::uint32_t>(count);
    chunk.data().resize(static_cast<std::size_t>(count) * width * sizeof(float));
    for (int i = 0; i < count; ++i) {
      std::uint8_t* row = chunk.data().data() + static_cast<std::size_t>(i) * width * sizeof(float);
      const float position =
          traversal.positions.empty() ? std::nanf("") : traversal.positions[static_cast<std::size_t>(first + i)];
      std::memcpy(row, &position, sizeof position);
      std::memcpy(row + sizeof(float), traversal.feature(first + i).data(), traversal.dimension * sizeof(float));
    }
    node_.publish(chunk);
  }
}

void EnvService::on_status(const msg::ServiceStatus& status) {
  if (options_.node.id != status.header().sender().c_str() || status.header().incarnation() >= node_.incarnation())
    return;
  // A dead predecessor's last heartbeat may still be delivered once; a living one goes on sending.
  if (status.service_state() == msg::STOPPING || ++predecessor_beats_[status.header().incarnation()] < 3) return;
  throw Error("another one with this id is alive in run '" + options_.node.run + "'",
              "env_service '" + options_.node.id + "'", "give this one another --id or --run");
}

void EnvService::tell_state() {
  const Clock::time_point now = Clock::now();
  if (now - rate_since_ < milliseconds(1000)) return;
  const double elapsed = std::chrono::duration<double>(now - rate_since_).count();
  const float rate = static_cast<float>(static_cast<double>(ticks_ - ticks_before_) * environment_.agents() / elapsed);
  rate_since_ = now;
  ticks_before_ = ticks_;
  if (refused_.version() != 0) return;  // FAILED stays until settings that can be kept
  if (mode_ == msg::IDLE || now - heard_ > kSilence) {
    node_.report(msg::WAITING, "waiting for a policy_service", rate);
  } else {
    node_.report(msg::RUNNING, mode_ == msg::TRAIN ? "training" : "evaluation", rate);
  }
}

}  // namespace

void run_env_service(const EnvServiceOptions& options, const Traversal& traversal, const std::function<bool()>& stop) {
  EnvService(options, traversal).run(stop);
}

}  // namespace citylearn
