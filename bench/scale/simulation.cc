// SPDX-License-Identifier: Apache-2.0
#include "bench/scale/simulation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <set>
#include <utility>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn::scale {

void Events::at(double when, std::function<void()> what) {
  queue_.push({std::max(when, now_), ++numbers_, std::move(what)});
}

void Events::run_until(double end) {
  while (!queue_.empty() && queue_.top().when <= end) {
    // top() is const for the order's sake; the function is no part of it.
    Event event = std::move(const_cast<Event&>(queue_.top()));
    queue_.pop();
    now_ = event.when;
    event.what();
  }
  now_ = end;
}

void Machine::advance() {
  const double elapsed = events_.now() - std::exchange(since_, events_.now());
  const auto busy = static_cast<double>(pieces_.size());
  if (busy == 0) return;
  const double share = std::min(1.0, cores_ / busy);
  service_ += share * elapsed;
  used_ += share * busy * elapsed;
}

void Machine::plan() {
  const std::uint64_t plan = ++plan_;
  if (pieces_.empty()) return;
  const double share = std::min(1.0, cores_ / static_cast<double>(pieces_.size()));
  events_.after(std::max(0.0, pieces_.top().until - service_) / share, [this, plan] {
    if (plan != plan_) return;  // something came in between
    advance();
    // The one that was planned is done, whatever rounding says.
    service_ = std::max(service_, pieces_.top().until);
    const auto done = std::move(const_cast<Piece&>(pieces_.top()).done);
    pieces_.pop();
    this->plan();
    done();
  });
}

void Machine::work(double seconds, std::function<void()> done) {
  advance();
  pieces_.push({service_ + seconds, ++numbers_, std::move(done)});
  plan();
}

double Machine::used() {
  advance();
  return used_;
}

void Thread::add(double seconds, std::function<void()> done) {
  queue_.emplace_back(working_ ? seconds : seconds + wake_, std::move(done));
  if (!working_) next();
}

void Thread::next() {
  working_ = !queue_.empty();
  if (!working_) return;
  auto [seconds, done] = std::move(queue_.front());
  queue_.pop_front();
  machine_.work(seconds, [this, seconds = seconds, done = std::move(done)] {
    used_ += seconds;
    done();
    next();
  });
}

void Link::send(double bytes, std::function<void()> passed) {
  bytes_ += bytes;
  free_ = std::max(free_, events_.now()) + bytes / rate_;
  events_.at(free_, std::move(passed));
}

namespace {

// As in env_service.cc, actor.cc and learner_server.cc.
constexpr double kObservationAgain = 0.05, kObservationAgainAtMost = 1;
constexpr double kTrajectoriesAgain = 0.2, kTrajectoriesAgainAtMost = 2;
constexpr std::uint64_t kOnTheWay = 48, kAtOnce = 16;

struct Host {
  Host(Events& events, const Layout& layout)
      : machine(events, layout.cores), in(events, layout.link), out(events, layout.link) {}
  Machine machine;
  Link in, out;
};

/// A service: the middleware's thread that receives, and its own.
struct Process {
  Process(int number, Host& where, const Costs& costs)
      : host(number),
        middleware(where.machine, costs.wake_middleware),
        main(where.machine, costs.wake),
        helper(where.machine) {}
  /// Both halves of something; `done` after the later one.
  void both(double own, double helpers, std::function<void()> done) {
    const auto halves = std::make_shared<int>(2);
    const auto half = [halves, done = std::move(done)] {
      if (--*halves == 0) done();
    };
    helper.add(helpers, half);
    main.add(own, half);
  }
  const int host;
  Thread middleware, main, helper;
  double sent = 0, received = 0;  // bytes
};

/// What all of a kind hear though it is for one of them, handed over from time to time.
struct Heard {
  double messages = 0, bytes = 0;
  std::vector<double> own_messages, own_bytes;  // by process; those came by themselves
};

class Run {
 public:
  Run(const Layout& layout, const Costs& costs, const Sizes& sizes, const Options& options);
  Outcome execute();

 private:
  struct Env : Process {
    Env(int host_number, Host& where, const Costs& costs, int own_index)
        : Process(host_number, where, costs), index(own_index) {}
    const int index;
    int actor = 0;
    std::uint64_t step = 0;      // of the Observation that waits
    std::uint64_t repeated = 0;  // times it was sent
    double since = 0;            // it was first sent
    Random random{0};
  };
  struct Seat {  // of an env_service at its actor
    int steps = 0;
    std::uint64_t next_step = 0;
    std::uint64_t version = 0;
    bool blocked = false;
    double blocked_since = 0;
    std::deque<std::uint64_t> unacknowledged;  // the last trajectory of each segment
  };
  struct Trajectory {
    std::uint64_t version;
  };
  struct Actor : Process {
    Actor(int host_number, Host& where, const Costs& costs, int own_index)
        : Process(host_number, where, costs), index(own_index) {}
    const int index;
    std::vector<int> envs;
    std::uint64_t number = 0, acknowledged = 0, sent_up_to = 0, limit = 0;
    std::deque<Trajectory> kept;  // acknowledged + 1 .. number
    double again = 0, interval = kTrajectoriesAgain;
    std::uint64_t version = 0;    // newest that is complete
    std::uint64_t receiving = 0;  // version
    int chunks = 0;               // of it
  };
  struct Known {  // actor at the learner
    std::uint64_t number = 0;
    std::size_t queued = 0;
    std::set<std::uint64_t> early;
    std::map<std::uint64_t, Trajectory> held;
  };

  Host& host(int number) { return *hosts_[static_cast<std::size_t>(number)]; }
  Actor& actor_of(const Env& env) { return *actors_[static_cast<std::size_t>(env.actor)]; }
  Seat& seat_of(const Env& env) { return seats_[static_cast<std::size_t>(env.index)]; }

  double copies_work(double copies, double bytes) const { return copies * (costs_.send + bytes * costs_.send_byte); }
  template <class Handle>
  void deliver(Process& from, Process& to, double bytes, double handling, Handle handle);
  void copies_out(Process& from, double copies, double bytes);
  template <class Processes>
  void hand_over(Heard& heard, Processes& processes, double period);
  template <class Other>
  void also_heard(Heard& heard, Other& by, double bytes);

  void publish_observation(Env& env, bool again);
  void watch_observation(Env& env, double interval);
  void on_observation(Env& env, std::uint64_t step);
  void answer(Env& env, bool again);
  void on_action(Env& env, std::uint64_t step);
  void end_segment(Env& env);
  void send_trajectories(Actor& actor);
  void publish_trajectory(Actor& actor, std::uint64_t number);
  void watch_trajectories(Actor& actor);
  void on_trajectory(Actor& actor, std::uint64_t number, Trajectory trajectory);
  template <class Done>
  void learner_works(const char* at, double seconds, Done done);
  void handled();
  void look_around();
  void acknowledge(Actor& actor);
  void on_acknowledgement(Actor& actor, std::uint64_t number, std::uint64_t limit);
  void learn();
  void send_parameters();
  void on_chunk(Actor& actor, std::uint64_t version);
  void beat(Process& process);
  void confirm_all();
  std::uint64_t limit_of(const Known& known) const;

  const Layout layout_;
  const Costs costs_;
  const Sizes sizes_;
  const Options options_;
  Events events_;
  std::vector<std::unique_ptr<Host>> hosts_;
  std::vector<std::unique_ptr<Env>> envs_;
  std::vector<std::unique_ptr<Actor>> actors_;
  std::unique_ptr<Process> learner_;
  std::vector<Seat> seats_;
  std::vector<Known> known_;  // actors, at the learner
  std::deque<std::pair<int, Trajectory>> queue_;
  Heard observations_, actions_, acknowledgements_, episode_acknowledgements_;
  std::set<int> to_acknowledge_, to_confirm_;  // actors; env_services with episodes
  bool planned_ = false;                       // to look around
  std::uint64_t version_ = 0;

  // What is counted from the end of the warm-up on.
  bool counting_ = false;
  double steps_ = 0, learned_ = 0, lag_ = 0, blocked_ = 0, began_ = 0;
  std::vector<float> answers_;
  Outcome outcome_;
};

Run::Run(const Layout& layout, const Costs& costs, const Sizes& sizes, const Options& options)
    : layout_(layout), costs_(costs), sizes_(sizes), options_(options) {
  if (layout.envs < 1 || layout.actors < 1 || layout.hosts < 1 || layout.batch < 1)
    throw Error("needs at least one env_service, actor, host and trajectory of an update", "layout");
  for (int i = 0; i < layout.hosts; ++i) hosts_.push_back(std::make_unique<Host>(events_, layout));
  learner_ = std::make_unique<Process>(0, host(0), costs_);
  for (int i = 0; i < layout.actors; ++i)
    actors_.push_back(std::make_unique<Actor>(i % layout.hosts, host(i % layout.hosts), costs_, i));
  for (int i = 0; i < layout.envs; ++i) {
    envs_.push_back(std::make_unique<Env>(i % layout.hosts, host(i % layout.hosts), costs_, i));
    envs_.back()->actor = i % layout.actors;
    envs_.back()->random = Random(mix_seeds({options.seed, static_cast<std::uint64_t>(i)}));
    actors_[static_cast<std::size_t>(i % layout.actors)]->envs.push_back(i);
  }
  seats_.resize(envs_.size());
  known_.resize(actors_.size());
  const std::size_t room = std::max<std::size_t>(1, 2 * static_cast<std::size_t>(layout.batch) / actors_.size());
  for (auto& actor : actors_) actor->limit = room;
  for (Heard* heard : {&actions_, &episode_acknowledgements_}) {
    heard->own_messages.resize(envs_.size());
    heard->own_bytes.resize(envs_.size());
  }
  for (Heard* heard : {&observations_, &acknowledgements_}) {
    heard->own_messages.resize(actors_.size());
    heard->own_bytes.resize(actors_.size());
  }
}

/// To the one it is for: over the links unless both are on one host, then its middleware's thread, then its own.
template <class Handle>
void Run::deliver(Process& from, Process& to, double bytes, double handling, Handle handle) {
  const auto arrive = [this, &to, bytes, handling, handle] {
    to.received += bytes;
    to.middleware.add(costs_.receive + bytes * costs_.receive_byte, [this, &to, bytes, handling, handle] {
      to.main.add(costs_.take + bytes * costs_.take_byte + handling, handle);
    });
  };
  if (from.host == to.host) return events_.after(layout_.latency / 2, arrive);
  host(from.host).out.send(bytes, [this, &to, bytes, arrive] {
    events_.after(layout_.latency, [this, &to, bytes, arrive] { host(to.host).in.send(bytes, arrive); });
  });
}

/// Those that are for nobody who hears them: they load the link; who hears them pays in hand_over().
void Run::copies_out(Process& from, double copies, double bytes) {
  from.sent += copies * bytes;
  const double away = copies * (1 - 1.0 / layout_.hosts);
  if (away > 0) host(from.host).out.send(away * bytes, [] {});
}

template <class Other>
void Run::also_heard(Heard& heard, Other& by, double bytes) {
  heard.own_messages[static_cast<std::size_t>(by.index)] += 1;
  heard.own_bytes[static_cast<std::size_t>(by.index)] += bytes;
}

template <class Processes>
void Run::hand_over(Heard& heard, Processes& processes, double period) {
  events_.after(period, [this, &heard, &processes, period] {
    for (std::size_t i = 0; i < processes.size(); ++i) {
      Process* const to = processes[i].get();
      const double messages = heard.messages - heard.own_messages[i], bytes = heard.bytes - heard.own_bytes[i];
      heard.own_messages[i] = heard.own_bytes[i] = 0;
      if (messages <= 0) continue;
      to->received += bytes;
      const auto arrive = [this, to, messages, bytes] {
        to->middleware.add(messages * costs_.receive + bytes * costs_.receive_byte, [this, to, messages, bytes] {
          to->main.add(messages * costs_.take + bytes * costs_.take_byte, [] {});
        });
      };
      if (layout_.hosts > 1)
        host(to->host).in.send(bytes * (1 - 1.0 / layout_.hosts), arrive);
      else
        arrive();
    }
    heard.messages = heard.bytes = 0;
    hand_over(heard, processes, period);
  });
}

// --- The step

void Run::publish_observation(Env& env, bool again) {
  Actor& actor = actor_of(env);
  const double copies = layout_.addressed_steps ? 1 : layout_.actors;
  // Of the copies, the one that counts goes out somewhere in the middle.
  const double half = copies_work((copies + 1) / 2, sizes_.observation);
  const double rest = copies_work((copies - 1) / 2, sizes_.observation);
  const double tick = again ? 0 : costs_.env_tick + costs_.env_agent * layout_.agents;
  const std::uint64_t step = env.step;
  env.main.add(tick + half, [this, &env, &actor, step, copies] {
    env.sent += sizes_.observation;
    deliver(env, actor, sizes_.observation, 0, [this, &env, step] { on_observation(env, step); });
    copies_out(env, copies - 1, sizes_.observation);
    if (layout_.addressed_steps) return;
    observations_.messages += 1;
    observations_.bytes += sizes_.observation;
    also_heard(observations_, actor, sizes_.observation);
  });
  if (rest > 0) env.main.add(rest, [] {});
}

void Run::watch_observation(Env& env, double interval) {
  const std::uint64_t step = env.step;
  events_.after(interval, [this, &env, step, interval] {
    if (env.step != step) return;
    ++env.repeated;
    if (counting_) ++outcome_.resent_observations;
    publish_observation(env, true);
    watch_observation(env, std::min(2 * interval, kObservationAgainAtMost));
  });
}

void Run::on_observation(Env& env, std::uint64_t step) {
  Seat& seat = seat_of(env);
  if (step < seat.next_step) return answer(env, true);  // our answer crossed the repetition
  if (seat.blocked || step > seat.next_step) return;
  // The step after the last one of a segment ends it: its values are needed (Collector::act).
  if (seat.steps < layout_.steps) return answer(env, false);
  end_segment(env);
}

void Run::answer(Env& env, bool again) {
  Actor& actor = actor_of(env);
  Seat& seat = seat_of(env);
  const std::uint64_t step = again ? seat.next_step - 1 : seat.next_step;
  if (!again) ++seat.next_step, ++seat.steps;
  const double copies = layout_.addressed_steps ? 1 : layout_.envs;
  const double half = copies_work((copies + 1) / 2, sizes_.action);
  const double rest = copies_work((copies - 1) / 2, sizes_.action);
  const double tick = again ? 0 : costs_.actor_tick + costs_.actor_agent * layout_.agents;
  const double helper = again ? 0 : costs_.actor_helper * layout_.agents;
  actor.both(tick + half, helper, [this, &env, &actor, step, copies] {
    actor.sent += sizes_.action;
    deliver(actor, env, sizes_.action, 0, [this, &env, step] { on_action(env, step); });
    copies_out(actor, copies - 1, sizes_.action);
    if (layout_.addressed_steps) return;
    actions_.messages += 1;
    actions_.bytes += sizes_.action;
    also_heard(actions_, env, sizes_.action);
  });
  if (rest > 0) actor.main.add(rest, [] {});
}

void Run::on_action(Env& env, std::uint64_t step) {
  if (step != env.step) return;
  if (counting_) {
    steps_ += layout_.agents;
    if (env.repeated == 0) answers_.push_back(static_cast<float>(events_.now() - env.since));
  }
  ++env.step;
  env.repeated = 0;
  env.since = events_.now();
  publish_observation(env, false);
  watch_observation(env, kObservationAgain);
  int finished = 0;
  for (int agent = 0; agent < layout_.agents; ++agent) finished += env.random.uniform() < layout_.episodes;
  if (finished == 0) return;
  const double copies = 1 + layout_.recorders;
  env.main.add(finished * copies_work(copies, sizes_.episode), [this, &env, finished] {
    for (int i = 0; i < finished; ++i) {
      env.sent += sizes_.episode;
      deliver(env, *learner_, sizes_.episode, 0, [this, &env] {
        to_confirm_.insert(env.index);
        handled();
      });
    }
    copies_out(env, finished * layout_.recorders, sizes_.episode);
  });
}

// --- Trajectories, there

void Run::end_segment(Env& env) {
  Actor& actor = actor_of(env);
  Seat& seat = seat_of(env);
  for (int agent = 0; agent < layout_.agents; ++agent) {
    if (actor.kept.empty()) {
      actor.interval = kTrajectoriesAgain;
      actor.again = events_.now() + actor.interval;
    }
    ++actor.number;
    actor.kept.push_back({seat.version});
  }
  seat.unacknowledged.push_back(actor.number);
  outcome_.most_unacknowledged = std::max<std::uint64_t>(outcome_.most_unacknowledged, seat.unacknowledged.size());
  seat.steps = 0;
  send_trajectories(actor);
  if (seat.unacknowledged.size() < static_cast<std::size_t>(layout_.window)) {
    seat.version = actor.version;
    return answer(env, false);
  }
  seat.blocked = true;
  seat.blocked_since = events_.now();
}

void Run::publish_trajectory(Actor& actor, std::uint64_t number) {
  const Trajectory trajectory = actor.kept[static_cast<std::size_t>(number - actor.acknowledged - 1)];
  actor.main.add(copies_work(1, sizes_.trajectory), [this, &actor, number, trajectory] {
    actor.sent += sizes_.trajectory;
    deliver(actor, *learner_, sizes_.trajectory, 0,
            [this, &actor, number, trajectory] { on_trajectory(actor, number, trajectory); });
  });
}

void Run::send_trajectories(Actor& actor) {
  const std::uint64_t until = std::min({actor.number, actor.limit, actor.acknowledged + kOnTheWay});
  while (actor.sent_up_to < until) {
    publish_trajectory(actor, ++actor.sent_up_to);
    ++outcome_.trajectories_sent;
  }
}

void Run::watch_trajectories(Actor& actor) {
  events_.after(0.05, [this, &actor] {
    if (actor.sent_up_to > actor.acknowledged && events_.now() >= actor.again) {
      for (std::uint64_t number = actor.acknowledged + 1;
           number <= std::min(actor.sent_up_to, actor.acknowledged + kAtOnce); ++number) {
        publish_trajectory(actor, number);
        ++outcome_.resent_trajectories;
      }
      actor.interval = std::min(2 * actor.interval, kTrajectoriesAgainAtMost);
      actor.again = events_.now() + actor.interval;
    }
    watch_trajectories(actor);
  });
}

std::uint64_t Run::limit_of(const Known& known) const {
  const std::size_t share = std::max<std::size_t>(1, 2 * static_cast<std::size_t>(layout_.batch) / actors_.size());
  return known.number + (share > known.queued ? share - known.queued : 0);
}

void Run::on_trajectory(Actor& actor, std::uint64_t number, Trajectory trajectory) {
  Known& known = known_[static_cast<std::size_t>(actor.index)];
  to_acknowledge_.insert(actor.index);
  if (number > known.number && number <= limit_of(known) && known.held.emplace(number, trajectory).second) {
    ++outcome_.trajectories_taken;
    while (!known.held.empty() && known.held.begin()->first == known.number + 1) {
      queue_.emplace_back(actor.index, known.held.begin()->second);
      known.held.erase(known.held.begin());
      ++known.number;
      ++known.queued;
    }
    outcome_.most_queued = std::max<std::uint64_t>(outcome_.most_queued, queue_.size());
  }
  handled();
}

// --- The learner, and back

template <class Done>
void Run::learner_works(const char* at, double seconds, Done done) {
  learner_->main.add(seconds, [this, at, seconds, done] {
    if (counting_) outcome_.learner_does[at] += seconds;
    done();
  });
}

/// It takes all that is there, then acknowledges, then learns if it has enough.
void Run::handled() {
  if (!std::exchange(planned_, true)) learner_->main.add(0, [this] { look_around(); });
}

void Run::look_around() {
  planned_ = false;
  for (const int index : std::exchange(to_acknowledge_, {})) acknowledge(*actors_[static_cast<std::size_t>(index)]);
  for (const int index : std::exchange(to_confirm_, {})) {
    const double copies = layout_.addressed_acknowledgements ? 1 : layout_.envs;
    const double bytes = sizes_.episode_acknowledgement;
    learner_works("episodes", copies_work(copies, bytes), [this, index, copies, bytes] {
      Env& env = *envs_[static_cast<std::size_t>(index)];
      learner_->sent += bytes;
      deliver(*learner_, env, bytes, 0, [] {});
      copies_out(*learner_, copies - 1, bytes);
      if (layout_.addressed_acknowledgements) return;
      episode_acknowledgements_.messages += 1;
      episode_acknowledgements_.bytes += bytes;
      also_heard(episode_acknowledgements_, env, bytes);
    });
  }
  if (queue_.size() >= static_cast<std::size_t>(layout_.batch)) learn();
}

void Run::acknowledge(Actor& actor) {
  const Known& known = known_[static_cast<std::size_t>(actor.index)];
  const double copies = layout_.addressed_acknowledgements ? 1 : layout_.actors;
  const std::uint64_t number = known.number, limit = limit_of(known);
  learner_works("acknowledgements", copies_work(copies, sizes_.acknowledgement), [this, &actor, number, limit, copies] {
    learner_->sent += sizes_.acknowledgement;
    deliver(*learner_, actor, sizes_.acknowledgement, 0,
            [this, &actor, number, limit] { on_acknowledgement(actor, number, limit); });
    copies_out(*learner_, copies - 1, sizes_.acknowledgement);
    if (layout_.addressed_acknowledgements) return;
    acknowledgements_.messages += 1;
    acknowledgements_.bytes += sizes_.acknowledgement;
    also_heard(acknowledgements_, actor, sizes_.acknowledgement);
  });
}

void Run::on_acknowledgement(Actor& actor, std::uint64_t number, std::uint64_t limit) {
  if (number < actor.acknowledged) return;
  actor.limit = limit;
  if (number > actor.acknowledged) {
    for (; actor.acknowledged < number; ++actor.acknowledged) actor.kept.pop_front();
    actor.sent_up_to = std::max(actor.sent_up_to, actor.acknowledged);
    actor.interval = kTrajectoriesAgain;
    actor.again = events_.now() + actor.interval;
  }
  for (const int index : actor.envs) {
    Seat& seat = seats_[static_cast<std::size_t>(index)];
    while (!seat.unacknowledged.empty() && seat.unacknowledged.front() <= actor.acknowledged)
      seat.unacknowledged.pop_front();
    if (!seat.blocked || seat.unacknowledged.size() >= static_cast<std::size_t>(layout_.window)) continue;
    seat.blocked = false;
    if (counting_) blocked_ += events_.now() - std::max(seat.blocked_since, began_);
    seat.version = actor.version;
    answer(*envs_[static_cast<std::size_t>(index)], false);
  }
  send_trajectories(actor);
}

void Run::learn() {
  double lag = 0;
  for (int i = 0; i < layout_.batch; ++i) {
    const auto [actor, trajectory] = queue_.front();
    queue_.pop_front();
    --known_[static_cast<std::size_t>(actor)].queued;
    lag += static_cast<double>(version_ - trajectory.version) / layout_.batch;
    ++outcome_.trajectories_learned;
  }
  const double steps = static_cast<double>(layout_.batch) * layout_.steps;
  const double work = costs_.update + steps * costs_.update_step / layout_.learner_speed;
  learner_->both(work, steps * costs_.update_helper / layout_.learner_speed, [this, lag, steps, work] {
    if (counting_) outcome_.learner_does["learning"] += work;
    ++version_;
    ++outcome_.updates;
    if (counting_) learned_ += steps, lag_ += lag * steps;
    send_parameters();
    for (auto& actor : actors_) acknowledge(*actor);  // there is room again
    handled();
  });
}

void Run::send_parameters() {
  const double copies = layout_.actors;
  for (int chunk = 0; chunk < sizes_.chunks; ++chunk)
    learner_works("parameters", copies_work(copies, sizes_.chunk), [this, version = version_] {
      for (auto& actor : actors_) {
        learner_->sent += sizes_.chunk;
        deliver(*learner_, *actor, sizes_.chunk, 0, [this, &actor, version] { on_chunk(*actor, version); });
      }
    });
}

/// One version at a time; what is newer than the one it began with waits for the next (ParameterAssembly).
void Run::on_chunk(Actor& actor, std::uint64_t version) {
  if (actor.chunks == 0 && version > actor.version) actor.receiving = version;
  if (version != actor.receiving) return;
  if (++actor.chunks < sizes_.chunks) return;
  actor.version = version;
  actor.chunks = 0;
}

/// Heartbeats, those of others, and what else there is every second.
void Run::beat(Process& process) {
  const double others = layout_.envs + layout_.actors + layout_.recorders;
  const double work = costs_.background + costs_.background_other * layout_.beats_heard * others;
  process.sent += costs_.background_sent + costs_.background_sent_other * layout_.beats_heard * others;
  process.middleware.add(work, [] {});
  events_.after(1, [this, &process] { beat(process); });
}

/// Every second all env_services hear again how far their episodes are recorded (EnvClient::spin).
void Run::confirm_all() {
  for (const auto& env : envs_) to_confirm_.insert(env->index);
  handled();
  events_.after(1, [this] { confirm_all(); });
}

Outcome Run::execute() {
  for (auto& actor : actors_) watch_trajectories(*actor);
  for (auto& env : envs_) {
    // Not all at once.
    events_.at(0.01 * env->random.uniform(), [this, &env] {
      env->since = events_.now();
      publish_observation(*env, false);
      watch_observation(*env, kObservationAgain);
    });
    events_.at(env->random.uniform(), [this, &env] { beat(*env); });
  }
  for (auto& actor : actors_) beat(*actor);
  beat(*learner_);
  events_.after(1, [this] { confirm_all(); });
  if (!layout_.addressed_steps) {
    hand_over(observations_, actors_, options_.gather);
    hand_over(actions_, envs_, options_.gather);
  }
  if (!layout_.addressed_acknowledgements) {
    hand_over(acknowledgements_, actors_, options_.gather);
    hand_over(episode_acknowledgements_, envs_, options_.gather);
  }
  events_.run_until(options_.warm_up);

  struct Look {
    double middleware, main, helper, sent, received;
  };
  const auto look = [](const Process& process) {
    return Look{process.middleware.used(), process.main.used(), process.helper.used(), process.sent, process.received};
  };
  const auto look_at_all = [&] {
    std::vector<Look> looks;
    for (const auto& env : envs_) looks.push_back(look(*env));
    for (const auto& actor : actors_) looks.push_back(look(*actor));
    looks.push_back(look(*learner_));
    return looks;
  };
  const auto hosts_used = [&] {
    std::vector<std::array<double, 3>> used;
    for (auto& each : hosts_) used.push_back({each->machine.used(), each->in.bytes(), each->out.bytes()});
    return used;
  };
  const std::vector<Look> before = look_at_all();
  const auto hosts_before = hosts_used();
  counting_ = true;
  began_ = events_.now();
  events_.run_until(options_.warm_up + options_.seconds);
  counting_ = false;
  for (const Seat& seat : seats_)
    if (seat.blocked) blocked_ += events_.now() - std::max(seat.blocked_since, began_);

  const double elapsed = options_.seconds;
  Outcome& o = outcome_;
  o.steps_per_second = steps_ / elapsed;
  o.learned_per_second = learned_ / elapsed;
  o.lag = learned_ > 0 ? lag_ / learned_ : 0;
  o.blocked = blocked_ / elapsed / static_cast<double>(envs_.size());
  if (!answers_.empty()) {
    std::sort(answers_.begin(), answers_.end());
    for (const float answer : answers_) o.answer += answer / static_cast<double>(answers_.size());
    o.answer_p99 = answers_[answers_.size() * 99 / 100];
  }
  const std::vector<Look> after = look_at_all();
  double rest = after.back().main - before.back().main;
  for (auto& [what, seconds] : o.learner_does) {
    rest -= seconds;
    seconds /= elapsed;
  }
  o.learner_does["taking"] = std::max(0.0, rest / elapsed);
  const auto busiest = [&](const std::string& what, double share) { o.busy[what] = std::max(o.busy[what], share); };
  const double steps = std::max(1.0, steps_);
  for (std::size_t i = 0; i < after.size(); ++i) {
    const double middleware = after[i].middleware - before[i].middleware, main = after[i].main - before[i].main;
    const double helper = after[i].helper - before[i].helper;
    const double sent = (after[i].sent - before[i].sent) / steps;
    const double received = (after[i].received - before[i].received) / steps;
    const bool env = i < envs_.size(), last = i + 1 == after.size();
    const std::string kind = env ? "env_service" : last ? "learner" : "actor";
    const double count = static_cast<double>(env ? envs_.size() : last ? 1 : actors_.size());
    (env ? o.env_cpu : last ? o.learner_cpu : o.actor_cpu) += (middleware + main + helper) / steps / count;
    (env ? o.env_sent : last ? o.learner_sent : o.actor_sent) += sent / count;
    (env ? o.env_received : last ? o.learner_received : o.actor_received) += received / count;
    busiest(kind, main / elapsed);
    busiest(kind + "'s middleware", middleware / elapsed);
  }
  const auto hosts_after = hosts_used();
  for (std::size_t i = 0; i < hosts_.size(); ++i) {
    busiest("processors", (hosts_after[i][0] - hosts_before[i][0]) / elapsed / layout_.cores);
    busiest("links in", (hosts_after[i][1] - hosts_before[i][1]) / elapsed / layout_.link);
    busiest("links out", (hosts_after[i][2] - hosts_before[i][2]) / elapsed / layout_.link);
  }
  for (const Known& known : known_) o.trajectories_waiting += known.held.size();
  o.trajectories_waiting += queue_.size();
  return o;
}

}  // namespace

Outcome simulate(const Layout& layout, const Costs& costs, const Sizes& sizes, const Options& options) {
  return Run(layout, costs, sizes, options).execute();
}

}  // namespace citylearn::scale
