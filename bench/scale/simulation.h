// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <queue>
#include <string>
#include <vector>

namespace citylearn::scale {

/// What happens next. Of one time, first come first served, so that a simulation is the same whenever it is run.
class Events {
 public:
  double now() const { return now_; }
  void at(double when, std::function<void()> what);
  void after(double delay, std::function<void()> what) { at(now_ + delay, std::move(what)); }
  /// All that happens up to `end`, which is then the time.
  void run_until(double end);

 private:
  struct Event {
    double when;
    std::uint64_t number;
    std::function<void()> what;
    bool operator>(const Event& other) const { return when != other.when ? when > other.when : number > other.number; }
  };
  std::priority_queue<Event, std::vector<Event>, std::greater<>> queue_;
  double now_ = 0;
  std::uint64_t numbers_ = 0;
};

/// The processors of a host, divided equally among the threads that have work, one at most for each: what a fair
/// scheduler does, seen from afar (processor sharing; Kleinrock, Queueing Systems II, section 4.4).
class Machine {
 public:
  Machine(Events& events, double cores) : events_(events), cores_(cores) {}
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;
  /// `done` once the thread has had `seconds` of a processor. A thread has one such piece of work at a time.
  void work(double seconds, std::function<void()> done);
  double used();  ///< seconds of processors so far
  double cores() const { return cores_; }

 private:
  struct Piece {
    double until;  // of service_
    std::uint64_t number;
    std::function<void()> done;
    bool operator>(const Piece& other) const {
      return until != other.until ? until > other.until : number > other.number;
    }
  };
  void advance();
  void plan();

  Events& events_;
  const double cores_;
  std::priority_queue<Piece, std::vector<Piece>, std::greater<>> pieces_;
  double service_ = 0;  // seconds that each thread with work has had
  double since_ = 0, used_ = 0;
  std::uint64_t numbers_ = 0, plan_ = 0;
};

/// Does one piece of work after the other. When it had none it sleeps; to be woken is work too.
class Thread {
 public:
  explicit Thread(Machine& machine, double wake = 0) : machine_(machine), wake_(wake) {}
  Thread(const Thread&) = delete;
  Thread& operator=(const Thread&) = delete;
  void add(double seconds, std::function<void()> done);
  double used() const { return used_; }  ///< seconds of its work so far

 private:
  void next();
  Machine& machine_;
  const double wake_;
  std::deque<std::pair<double, std::function<void()>>> queue_;
  bool working_ = false;
  double used_ = 0;
};

/// One direction of a host's network link: bytes in order, at a rate.
class Link {
 public:
  Link(Events& events, double bytes_per_second) : events_(events), rate_(bytes_per_second) {}
  /// `passed` once they have.
  void send(double bytes, std::function<void()> passed);
  double bytes() const { return bytes_; }
  double rate() const { return rate_; }

 private:
  Events& events_;
  const double rate_;
  double free_ = 0, bytes_ = 0;
};

/// Seconds of a processor that things take, of one middleware. Measured; calibration.h finds them.
struct Costs {
  // Of every message. A copy is what goes to one of several that hear a topic.
  double send = 0, send_byte = 0;        ///< a copy, by the thread that publishes
  double receive = 0, receive_byte = 0;  ///< by the middleware's threads
  double take = 0, take_byte = 0;        ///< to decode it, whether or not it is for whoever hears it
  double wake_middleware = 0, wake = 0;  ///< a thread of the middleware that slept, and the service's own
  // Of an env_service's tick: the environment, and its Observation. Of an actor's: the network.
  double env_tick = 0, env_agent = 0;
  double actor_tick = 0, actor_agent = 0;
  double actor_helper = 0;  ///< an agent, by the thread that does one half of them beside
  // Of the learner.
  double update_step = 0;    ///< to learn from one step
  double update = 0;         ///< beside it, for each update
  double update_helper = 0;  ///< a step, by the thread that does one half beside
  // Of every service and second, for each other one: heartbeats and discovery.
  double background = 0, background_other = 0;
  double background_sent = 0, background_sent_other = 0;  ///< bytes
};

/// Bytes on the wire of one message, with everything around it; none of them depends on who hears it.
struct Sizes {
  double observation = 0, action = 0;
  double trajectory = 0, acknowledgement = 0;
  double chunk = 0;  ///< of parameters
  double episode = 0, episode_acknowledgement = 0;
  int chunks = 1;  ///< of one version of the parameters
};

/// Who is there, and how a run is set.
struct Layout {
  int envs = 1, agents = 16, actors = 1;  ///< agents of one env_service
  int hosts = 1;                          ///< the learner on the first, env_services and actors over all of them
  double cores = 2;                       ///< of a host
  double link = 1e12;                     ///< bytes/s of a host's network, each way
  double latency = 20e-6;                 ///< seconds between two hosts
  int steps = 64;                         ///< L: of a Trajectory
  int batch = 16;                         ///< Trajectories of an update: --trainer-agents
  int window = 2;                         ///< --window
  double episodes = 0.03;                 ///< that end, per step
  int recorders = 0;                      ///< beside the learner
  // What could be different.
  bool addressed_steps = false;             ///< Observations reach their actor alone, Actions their env_service
  bool addressed_acknowledgements = false;  ///< each reaches whom it is for
  double learner_speed = 1;                 ///< of learning from a step
  double beats_heard = 1;                   ///< share of the other services whose heartbeats a service hears
};

struct Options {
  double warm_up = 1, seconds = 2;  ///< of the run, before and while it is looked at
  double gather = 50e-6;            ///< seconds; what one thread gets that is not for it is handed over so often
  std::uint64_t seed = 1;
};

/// What was seen, per second of the run or per step of one agent.
struct Outcome {
  double steps_per_second = 0;  ///< taken
  double learned_per_second = 0;
  double lag = 0;      ///< mean, updates
  double blocked = 0;  ///< share of the time that an env_service waits for the learner's acknowledgements
  double answer = 0;   ///< mean seconds from an Observation to its Action, without those that were blocked
  double answer_p99 = 0;
  // Seconds of processors per step, of one service of the kind.
  double env_cpu = 0, actor_cpu = 0, learner_cpu = 0;
  // Bytes per step, of one service of the kind.
  double env_sent = 0, env_received = 0, actor_sent = 0, actor_received = 0, learner_sent = 0, learner_received = 0;
  /// Shares of the time that each thing was at work, the busiest of its kind: "learner", "learner's middleware",
  /// "env_service", "actor", ..., "processors", "links in", "links out".
  std::map<std::string, double> busy;
  /// What the learner's own thread does, shares of the time: "learning", "taking", "parameters", "acknowledgements" (of
  /// trajectories), "episodes" (acknowledgements of them).
  std::map<std::string, double> learner_does;
  // For tests: nothing is lost or comes twice.
  std::uint64_t trajectories_sent = 0, trajectories_taken = 0, trajectories_learned = 0, trajectories_waiting = 0;
  std::uint64_t updates = 0, resent_observations = 0, resent_trajectories = 0;
  std::uint64_t most_unacknowledged = 0;  ///< segments of one env_service
  std::uint64_t most_queued = 0;          ///< trajectories at the learner
};

/// A run with one learner, as docs/decisions/0003-step-protocol.md and 0008-roles.md have it.
Outcome simulate(const Layout& layout, const Costs& costs, const Sizes& sizes, const Options& options = {});

}  // namespace citylearn::scale
