// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/actor.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <sstream>

#include "core/wire/rejections.h"
#include "core/wire/service.h"
#include "policy_service/distributed/env_client.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/distributed/parameter_chunks.h"
#include "policy_service/distributed/trajectories.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kStatusAgain{1};
constexpr seconds kSettle{1};  // others are heard before anything is taken
constexpr milliseconds kAssign{100};
constexpr milliseconds kAskAgain{50}, kTrajectoriesAgain{200}, kTrajectoriesAgainAtMost{2000};
constexpr milliseconds kLeaving{500};
constexpr std::size_t kAtOnce = 16;      // trajectories sent again at a time
constexpr std::uint64_t kOnTheWay = 48;  // at most, unacknowledged: a writer keeps little more
constexpr int kAskedInVain = 20;         // times in a row, then the version is given up

enum Purpose : std::uint64_t { kSession = 105 };  // of a random stream

/// All actors of a run need ids of their own, on whatever host.
std::string own_id() {
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  return ("actor-" + std::string(host).substr(0, 40) + "-" + std::to_string(getpid())).substr(0, 64);
}

Node::Options named(Node::Options options) {
  options.service = "policy_service";
  if (options.id.empty()) options.id = own_id();
  return options;
}

/// "cells=256 hidden=512" as a learner writes it.
std::map<std::string, double> parse_parameters(const std::string& text) {
  std::map<std::string, double> values;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::size_t equals = word.find('=');
    try {
      if (equals == word.npos) throw std::invalid_argument(word);
      values[word.substr(0, equals)] = std::stod(word.substr(equals + 1));
    } catch (const std::logic_error&) {
      throw Error("'" + word + "' is not name=value", "LearnerInfo.network");
    }
  }
  return values;
}

/// Why no learner says so; empty when one may.
std::string nonsense(const msg::LearnerInfo& info) {
  if (info.steps() < 1 || info.steps() > msg::MAX_STEPS) return "with trajectories of " + std::to_string(info.steps());
  if (info.lesson_frames() < 1 || info.lesson_frames() > info.frames()) return "with a lesson beyond the route";
  if (info.window() < 1) return "that wants nothing";
  for (const double noise : {info.noise_frame(), info.noise_place(), info.noise_episode()})
    if (!std::isfinite(noise) || noise < 0) return "with a noise that is no length";
  return "";
}

class Actor {
 public:
  explicit Actor(const ActorOptions& options);
  int execute();

 private:
  using ParametersUsed = std::shared_ptr<const VersionedParameters>;
  struct Served {
    int slot = 0;               // names its random streams; never used twice
    ParametersUsed parameters;  // of the whole segment
    msg::SettingsId settings;
    std::uint64_t segment_step = 0;      // of the segment's first observation
    bool blocked = false;                // its segment is sent, the next one has not begun
    std::deque<std::uint64_t> segments;  // unacknowledged: the number of the last trajectory of each
  };
  struct Other {  // actor
    std::uint64_t incarnation = 0;
    Presence presence;
    std::set<std::uint64_t> environments;
  };
  /// All that belongs to one incarnation of a learner.
  struct Session {
    msg::LearnerInfo info;
    NetworkTask task;
    std::unique_ptr<const AgentNetwork<float>> network;
    std::unique_ptr<Collector> collector;
    std::unique_ptr<ParameterAssembly> parameters;
    std::uint64_t number = 0, acknowledged = 0, sent = 0, limit = 0;  // of trajectories
    std::deque<msg::Trajectory> unacknowledged;                       // acknowledged + 1 .. number
    Clock::time_point again{};
    milliseconds interval = kTrajectoriesAgain;
    Clock::time_point ask{};
    std::optional<ParameterAssembly::Missing> asked;
    int in_vain = 0;    // times in a row that none of it came
    bool over = false;  // and everything is let go of
  };

  void spin();
  void on_info(const msg::LearnerInfo& info);
  void on_status(const msg::ActorStatus& status);
  void on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement);
  void on_parameters(const msg::PolicyParameters& chunk);
  bool of_learner(const msg::Header& header, const std::string& what);
  bool ours(const Seat& seat) const;
  bool prepare();
  void assign();
  void enroll(Seat& seat);
  void drop(Seat& seat, bool idle);
  bool decide(Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  bool may_go_on(const Served& served) const;
  void go_on(Served& served, std::vector<std::uint8_t>& choice);
  void send_segment(Seat& seat, Served& served);
  void send_trajectories();
  void ask_for_parameters();
  void send_status();
  const std::string* served_by(const Seat& seat) const;
  std::string why_idle() const;
  void report();
  void leave();

  ActorOptions options_;
  Node node_;
  Fleet fleet_;
  Rejections rejections_;
  std::unique_ptr<Session> session_;
  std::map<Seat*, Served> served_;
  std::map<std::string, Other> others_;
  std::uint64_t steps_ = 0;
  int slots_ = 0;
  bool answered_ = false;  // the learner has answered our last status
  bool warned_ = false;
  std::string told_;  // why nothing is served, as logged
  double waited_ = 0;
  Presence learner_presence_;
  Clock::time_point started_, next_status_{}, next_assign_{}, next_report_{}, last_report_, last_turn_;
  std::vector<std::uint8_t> choice_;
  msg::LearnerInfo info_;
  msg::ActorStatus status_, own_status_;
  msg::TrajectoryAcknowledgement acknowledgement_;
  msg::PolicyParameters chunk_;
};

Actor::Actor(const ActorOptions& options)
    : options_(options), node_(named(options.node)), fleet_(node_), rejections_(node_) {
  node_.create_writer<msg::ActorStatus>();
  node_.create_writer<msg::Trajectory>();
  node_.create_writer<msg::ParametersRequest>();
  node_.create_reader<msg::LearnerInfo>();
  node_.create_reader<msg::ActorStatus>();
  node_.create_reader<msg::TrajectoryAcknowledgement>();
  node_.create_reader<msg::PolicyParameters>();
  fleet_.hear(/*observations=*/true, /*episodes=*/false);
  fleet_.decide = [this](Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    return decide(seat, observation, choice);
  };
  fleet_.joined = [this](Seat& seat) { drop(seat, false); };  // a new incarnation: assign() takes it again
  started_ = last_report_ = last_turn_ = Clock::now();
}

// The learner.

/// Of the learner this actor works for. Others are of an earlier process, or not to be believed.
bool Actor::of_learner(const msg::Header& header, const std::string& what) {
  const msg::Header& learner = session_->info.header();
  if (header.incarnation() == learner.incarnation() && header.sender() == learner.sender()) return true;
  if (header.incarnation() < learner.incarnation())
    ++node_.traffic.repeated;
  else
    rejections_.add(header, what + " of who is not the learner");
  return false;
}

void Actor::on_info(const msg::LearnerInfo& info) {
  if (const std::string wrong = nonsense(info); !wrong.empty()) {
    rejections_.add(info.header(), "a learner " + wrong);
    return;
  }
  const bool fresh = !session_ || info.header().incarnation() > session_->info.header().incarnation();
  if (!fresh && !of_learner(info.header(), "an announcement")) return;
  learner_presence_.heard(Clock::now());
  if (!fresh) {
    const bool lesson = info.lesson() != session_->info.lesson();
    session_->info = info;
    if (session_->parameters &&
        !session_->parameters->expect(info.version(), info.total_bytes(), info.hash(), info.chunks()))
      throw Error("has other parameters than network '" + std::string(info.agent().c_str()) + "' of this program",
                  "learner '" + std::string(info.header().sender().c_str()) + "'", "run the same version everywhere");
    if (!lesson || !session_->collector) return;
    // Unacknowledged ones stay: the learner counts them, and drops what is of an old lesson.
    session_->collector->begin_cut(
        mix_seeds({kSession, node_.incarnation(), info.header().incarnation(), info.lesson()}),
        static_cast<int>(info.lesson_frames()));
    for (auto& [seat, served] : std::map<Seat*, Served>(served_)) enroll(*seat);
    return;
  }
  if (!info.training()) return;  // it has done already
  spdlog::info("learner '{}'{}: {} on '{}', version {}", info.header().sender().c_str(), session_ ? " is back" : "",
               info.agent().c_str(), info.traversal().c_str(), info.version());
  // What another incarnation has not taken is of no use to this one, which may go on from an older checkpoint.
  for (const auto& [seat, served] : std::map<Seat*, Served>(served_)) drop(*seat, true);
  session_ = std::make_unique<Session>();
  session_->info = info;
  warned_ = false;
  next_status_ = Clock::now();
}

bool Actor::ours(const Seat& seat) const {
  return seat.traversal() == session_->info.traversal().c_str() &&
         seat.info.hash() == session_->info.traversal_hash() && Fleet::alive(seat);
}

/// Network and collector, as soon as the route's features can be had. True when they are there.
bool Actor::prepare() {
  Session& s = *session_;
  if (s.collector) return true;
  const msg::LearnerInfo info = s.info;
  Seat* source = nullptr;
  for (const auto& [id, seat] : fleet_.seats())
    if (ours(*seat)) source = seat.get();
  if (!source) return false;
  NetworkTask task;
  task.frames = static_cast<int>(info.frames());
  task.features = static_cast<int>(info.feature_dimension());
  if (task.features > 0) {
    try {
      const std::vector<float> features =
          fleet_.fetch_features(*source, static_cast<int>(info.first_frame()), task.frames, Clock::now() + seconds(10));
      task.reference = Eigen::Map<const Matrix<float>>(features.data(), task.features, task.frames);
    } catch (const Error& error) {  // it may have died; another one will do
      spdlog::warn("{}", error.what());
      return false;
    }
  }
  s.task = std::move(task);
  const auto& entry = NetworkRegistry<float>::instance().find("network", info.agent().c_str());
  s.network = entry.create(
      Parameters("network " + entry.name, entry.parameters, parse_parameters(info.network().c_str())), s.task);
  const int steps = static_cast<int>(info.steps());
  s.collector =
      std::make_unique<Collector>(CollectorOptions{info.seed(), static_cast<int>(info.first_frame()), steps, steps,
                                                   info.noise_frame(), info.noise_place(), info.noise_episode()},
                                  s.task, *s.network);
  // No two actors, nor two incarnations of one, draw the same.
  s.collector->begin_cut(mix_seeds({kSession, node_.incarnation(), info.header().incarnation(), info.lesson()}),
                         static_cast<int>(info.lesson_frames()));
  s.parameters = std::make_unique<ParameterAssembly>(s.network->parameter_count());
  on_info(info);
  return true;
}

void Actor::on_parameters(const msg::PolicyParameters& chunk) {
  if (!session_ || !session_->parameters || !of_learner(chunk.header(), "parameters")) return;
  if (!session_->parameters->take(chunk)) rejections_.add(chunk.header(), "parameters that are damaged");
}

/// Asks for what was lost, or was sent before we came; for more at once when all that was asked for has come.
void Actor::ask_for_parameters() {
  Session& s = *session_;
  const auto missing = s.parameters->missing();
  const Clock::time_point now = Clock::now();
  if (!missing) {
    s.asked.reset();
    s.ask = now + kAskAgain;  // what is on its way need not be asked for
    return;
  }
  const bool known = s.asked && s.asked->version == missing->version;
  const bool more = known && missing->chunks.front() > s.asked->chunks.back();
  const bool late = !known && !s.parameters->newest();
  if (now < s.ask && !more && !late) return;
  s.in_vain = known && missing->chunks == s.asked->chunks ? s.in_vain + 1 : 0;
  if (s.in_vain > kAskedInVain) {
    s.parameters->give_up();
    s.asked.reset();
    return;
  }
  s.asked = missing;
  msg::ParametersRequest request;
  request.learner() = s.info.header().sender();
  request.version() = missing->version;
  request.chunks() = missing->chunks;
  node_.publish(request);
  s.ask = now + kAskAgain;
}

// Which env_services.

void Actor::on_status(const msg::ActorStatus& status) {
  const std::string id = status.header().sender().c_str();
  if (id == node_.options().id) {
    // The incarnation is the time of the start, so of two only one gives way.
    if (status.header().incarnation() < node_.incarnation())
      throw Error("already runs in session '" + node_.options().session + "'", "id '" + id + "'",
                  "choose another --id or --session");
    return;
  }
  Other& other = others_[id];
  if (status.header().incarnation() < other.incarnation) return;
  other.incarnation = status.header().incarnation();
  other.presence.heard(Clock::now());
  other.environments = std::set<std::uint64_t>(status.environments().begin(), status.environments().end());
}

/// Id of the other actor that says it serves the seat; null: none does.
const std::string* Actor::served_by(const Seat& seat) const {
  const auto other = std::find_if(others_.begin(), others_.end(), [&](const auto& entry) {
    return entry.second.environments.contains(seat.incarnation());
  });
  return other == others_.end() ? nullptr : &other->first;
}

/// Every actor has its share of the env_services: as many as there are for each, and the first ones by id one more
/// while some are left. It takes what nobody has, and lets go of what is beyond its share; whoever took charge last has
/// it.
void Actor::assign() {
  const Clock::time_point now = Clock::now();
  if (now < next_assign_ || now < started_ + kSettle) return;
  next_assign_ = now + kAssign;
  std::erase_if(others_, [&](const auto& entry) { return !entry.second.presence.here(now); });
  std::vector<Seat*> lost;
  for (const auto& [seat, served] : served_)
    if (Fleet::lost(*seat) || !ours(*seat)) lost.push_back(seat);
  for (Seat* seat : lost) {
    spdlog::info("env_service '{}' {}", seat->id, Fleet::lost(*seat) ? "is served by another one" : "is gone");
    drop(*seat, false);
  }
  std::size_t all = 0;
  std::vector<Seat*> free;
  for (const auto& [id, seat] : fleet_.seats()) {
    if (!ours(*seat)) continue;
    ++all;
    if (!served_.contains(seat.get()) && !served_by(*seat) && !seat->busy) free.push_back(seat.get());
  }
  const std::size_t actors = others_.size() + 1;
  const auto before = static_cast<std::size_t>(std::count_if(
      others_.begin(), others_.end(), [&](const auto& entry) { return entry.first < node_.options().id; }));
  const std::size_t share = std::min<std::size_t>(all / actors + (before < all % actors ? 1 : 0), msg::MAX_SERVED);
  while (served_.size() > share) {
    Seat* last = std::max_element(served_.begin(), served_.end(), [](const auto& a, const auto& b) {
                   return a.first->id < b.first->id;
                 })->first;
    spdlog::info("lets go of env_service '{}': its share is {} of {}", last->id, share, all);
    drop(*last, true);
  }
  // Not all begin with the same one.
  for (std::size_t i = 0; i < free.size() && served_.size() < share; ++i) {
    Seat& seat = *free[(before + i) % free.size()];
    fleet_.take_charge(seat);
    enroll(seat);
    spdlog::info("serves env_service '{}'", seat.id);
    told_.clear();
  }
}

void Actor::enroll(Seat& seat) {
  Session& s = *session_;
  Served& served = served_[&seat];
  if (served.slot > 0) s.collector->remove(served.slot);
  served = Served();
  served.slot = ++slots_;
  s.collector->add(served.slot, static_cast<int>(seat.info.agents()));
  msg::TaskSettings settings;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = s.info.lesson();
  settings.first_frame() = s.info.first_frame();
  settings.frames() = s.info.lesson_frames();
  settings.max_steps() = s.info.max_steps();
  settings.seed() = s.collector->environment_seed(served.slot);
  settings.policy() = s.info.agent();
  settings.update() = s.parameters->newest() ? s.parameters->newest()->version : s.info.version();
  settings.run_id() = s.info.run_id();
  fleet_.command(seat, settings);
  served.settings = seat.settings.settings();
  next_status_ = Clock::now();
}

/// `idle`: tells the env_service, so that others may take it at once.
void Actor::drop(Seat& seat, bool idle) {
  const auto found = served_.find(&seat);
  if (found == served_.end()) return;
  session_->collector->remove(found->second.slot);
  served_.erase(found);
  if (idle) {
    msg::TaskSettings settings;
    settings.task_mode() = msg::IDLE;
    fleet_.command(seat, settings);
  } else {
    Fleet::let_go(seat);
  }
  next_status_ = Clock::now();
}

void Actor::send_status() {
  next_status_ = Clock::now() + kStatusAgain;
  own_status_.learner() = session_ ? session_->info.header().sender().c_str() : "";
  own_status_.learner_incarnation() = session_ ? session_->info.header().incarnation() : 0;
  const bool acts = session_ && session_->parameters && session_->parameters->newest();
  own_status_.version() = acts ? session_->parameters->newest()->version : 0;
  own_status_.environments().clear();
  for (const auto& [seat, served] : served_) own_status_.environments().push_back(seat->incarnation());
  own_status_.unacknowledged() = session_ ? static_cast<std::uint32_t>(session_->unacknowledged.size()) : 0;
  own_status_.waiting() =
      std::any_of(served_.begin(), served_.end(), [](const auto& entry) { return entry.second.blocked; });
  own_status_.waited() = waited_;
  answered_ = false;
  node_.publish(own_status_);
}

// Acting.

bool Actor::decide(Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  const auto found = served_.find(&seat);
  if (found == served_.end()) return false;
  Served& served = found->second;
  if (!served.parameters) served.parameters = session_->parameters->newest();
  if (session_->collector->act(served.slot, observation, served.parameters->values, choice)) {
    steps_ += choice.size();
    return true;
  }
  send_segment(seat, served);
  if (!may_go_on(served)) {
    served.blocked = true;
    return false;
  }
  go_on(served, choice);
  return true;
}

bool Actor::may_go_on(const Served& served) const { return served.segments.size() < session_->info.window(); }

/// The next segment, with the newest parameters that are complete.
void Actor::go_on(Served& served, std::vector<std::uint8_t>& choice) {
  served.blocked = false;
  served.parameters = session_->parameters->newest();
  session_->collector->resume(served.slot, served.parameters->values, choice);
  steps_ += choice.size();
}

void Actor::send_segment(Seat& seat, Served& served) {
  Session& s = *session_;
  const Rollout& rollout = s.collector->rollout(served.slot);
  if (s.unacknowledged.empty()) {
    s.interval = kTrajectoriesAgain;
    s.again = Clock::now() + s.interval;
  }
  for (int agent = 0; agent < rollout.inputs.agents; ++agent) {
    msg::Trajectory& trajectory = s.unacknowledged.emplace_back();
    trajectory.learner() = s.info.header().sender();
    trajectory.learner_incarnation() = s.info.header().incarnation();
    trajectory.number() = ++s.number;
    trajectory.environment() = seat.id.c_str();
    trajectory.agent() = static_cast<std::uint32_t>(agent);
    trajectory.settings() = served.settings;
    trajectory.step() = served.segment_step;
    trajectory.lesson() = seat.settings.lesson();
    trajectory.version() = served.parameters->version;
    pack(rollout, agent, trajectory);
  }
  served.segment_step += static_cast<std::uint64_t>(rollout.inputs.steps);
  served.segments.push_back(s.number);
  s.collector->begin_segment(served.slot);
  send_trajectories();
}

/// What there is room for goes out at once, and the first ones again when no acknowledgement comes.
void Actor::send_trajectories() {
  Session& s = *session_;
  const auto publish = [&](std::uint64_t number) {
    node_.publish(s.unacknowledged[static_cast<std::size_t>(number - s.acknowledged - 1)]);
  };
  const std::uint64_t until = std::min({s.number, s.limit, s.acknowledged + kOnTheWay});
  while (s.sent < until) publish(++s.sent);
  const Clock::time_point now = Clock::now();
  if (s.sent <= s.acknowledged || now < s.again) return;
  for (std::uint64_t number = s.acknowledged + 1; number <= std::min(s.sent, s.acknowledged + kAtOnce); ++number) {
    publish(number);
    ++node_.traffic.resent;
  }
  s.interval = std::min(2 * s.interval, kTrajectoriesAgainAtMost);
  s.again = now + s.interval;
}

void Actor::on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement) {
  if (!session_ || acknowledgement.actor() != node_.options().id ||
      acknowledgement.actor_incarnation() != node_.incarnation() ||
      !of_learner(acknowledgement.header(), "an acknowledgement"))
    return;
  answered_ = true;
  Session& s = *session_;
  if (acknowledgement.number() > s.number) {
    rejections_.add(acknowledgement.header(), "an acknowledgement of trajectories that were never sent");
    return;
  }
  if (acknowledgement.number() < s.acknowledged) {  // an older one
    ++node_.traffic.repeated;
    return;
  }
  s.limit = acknowledgement.limit();
  if (acknowledgement.number() > s.acknowledged) {
    for (; s.acknowledged < acknowledgement.number(); ++s.acknowledged) s.unacknowledged.pop_front();
    s.sent = std::max(s.sent, s.acknowledged);
    s.interval = kTrajectoriesAgain;
    s.again = Clock::now() + s.interval;
    for (auto& [seat, served] : served_)
      while (!served.segments.empty() && served.segments.front() <= s.acknowledged) served.segments.pop_front();
  }
  send_trajectories();
}

// All together.

void Actor::spin() {
  fleet_.spin(Clock::now() + milliseconds(50));
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(chunk_)) on_parameters(chunk_);
  while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  const Clock::time_point now = Clock::now();
  const bool waiting =
      std::any_of(served_.begin(), served_.end(), [](const auto& entry) { return entry.second.blocked; });
  if (waiting) waited_ += std::chrono::duration<double>(now - last_turn_).count();
  last_turn_ = now;
  if (session_ && session_->info.training() && prepare()) {
    ask_for_parameters();
    if (session_->parameters->newest()) assign();
    for (auto& [seat, served] : served_) {
      if (!served.blocked || !seat->waiting || !may_go_on(served)) continue;
      go_on(served, choice_);
      fleet_.answer(*seat, choice_);
    }
    send_trajectories();
  }
  if (now >= next_status_) send_status();
  if (now >= next_report_) report();
}

/// What stands between this actor and an env_service; it serves none.
std::string Actor::why_idle() const {
  const Session& s = *session_;
  if (!s.info.training()) return "waiting for the next learner";
  const std::string traversal = s.info.traversal().c_str();
  std::string theirs;
  std::size_t all = 0;
  for (const auto& [id, seat] : fleet_.seats()) {
    if (!ours(*seat)) continue;
    ++all;
    const std::string* other = served_by(*seat);
    theirs += (theirs.empty() ? " ('" : ", '") + id + "' ";
    theirs += other ? "is served by '" + *other + "'" : seat->busy ? "gets actions from somebody" : "is free";
  }
  if (all == 0) return "waiting for an env_service on '" + traversal + "' as the learner knows it";
  if (!s.collector) return "waiting for the features of '" + traversal + "'";
  if (!s.parameters->newest())
    return "waiting for parameters of learner '" + std::string(s.info.header().sender().c_str()) + "'";
  return fmt::format("waiting for an env_service that no other actor serves{})", theirs);
}

void Actor::report() {
  const Clock::time_point now = Clock::now();
  const double rate = static_cast<double>(std::exchange(steps_, 0)) /
                      std::max(1e-3, std::chrono::duration<double>(now - last_report_).count());
  last_report_ = now;
  next_report_ = now + seconds(1);
  if (!session_) {
    node_.report(msg::WAITING, "waiting for a learner");
    return;
  }
  const std::string learner = session_->info.header().sender().c_str();
  const bool silent = !learner_presence_.here(now);
  if (silent && !std::exchange(warned_, true))
    spdlog::warn("learner '{}' is silent: going on as far as {} unacknowledged segments, then waiting", learner,
                 session_->info.window());
  if (!silent && std::exchange(warned_, false)) spdlog::info("learner '{}' is heard again", learner);
  if (own_status_.waiting()) {
    node_.report(msg::WAITING,
                 fmt::format("waiting for learner '{}' to take {} trajectories{}; {:.0f} s so far", learner,
                             session_->unacknowledged.size(), silent ? ", which is silent" : "", waited_),
                 static_cast<float>(rate));
  } else if (served_.empty()) {
    const std::string why = why_idle();
    if (std::exchange(told_, why) != why) spdlog::info("{}", why);
    node_.report(msg::WAITING, why);
  } else {
    node_.report(msg::RUNNING,
                 fmt::format("acting on {} env_service{} for learner '{}', version {}", served_.size(),
                             served_.size() == 1 ? "" : "s", learner, own_status_.version()),
                 static_cast<float>(rate));
  }
}

/// The learner hears that nothing is served any more, or has gone itself.
void Actor::leave() {
  send_status();
  const Clock::time_point deadline = Clock::now() + kLeaving;
  while (!answered_ && Clock::now() < deadline) {
    fleet_.spin(std::min(deadline, Clock::now() + milliseconds(50)));
    while (node_.take(info_)) continue;
    while (node_.take(status_)) continue;
    while (node_.take(chunk_)) continue;
    while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  }
}

int Actor::execute() {
  const Farewell farewell(node_);
  spdlog::info("actor '{}' in session '{}' over {}", node_.options().id, node_.options().session,
               node_.middleware_name());
  while (!stop_requested()) {
    spin();
    if (!session_ || session_->info.training() || session_->over) continue;
    session_->over = true;
    // The learner takes charge of the env_services itself.
    for (const auto& [seat, served] : std::map<Seat*, Served>(served_)) drop(*seat, false);
    spdlog::info("learner '{}' has done: sent it {} trajectories, waited {:.1f} s for room",
                 session_->info.header().sender().c_str(), session_->number, waited_);
    if (options_.stay) continue;
    leave();
    return 0;
  }
  for (const auto& [seat, served] : std::map<Seat*, Served>(served_)) drop(*seat, true);
  leave();
  spdlog::info("stopped by a signal");
  return 130;
}

}  // namespace

int run_actor(const ActorOptions& options) { return Actor(options).execute(); }

}  // namespace citylearn
