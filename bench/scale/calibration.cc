// SPDX-License-Identifier: Apache-2.0
#include "bench/scale/calibration.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>
#include <tuple>
#include <utility>

#include "core/wire/blob.h"
#include "core/wire/messages.h"
#include "policy_service/env_client/env_client_options.h"
#include "policy_service/network/agent_network.h"

namespace citylearn::scale {

double Used::operator[](const std::string& column) const {
  const auto found = values.find(column);
  if (found == values.end()) throw Error("is not there", "column " + column);
  return found->second;
}

const Used& Measured::used(const std::string& phase, const std::string& kind) const {
  const auto found = phases.find(phase);
  if (found == phases.end() || !found->second.contains(kind))
    throw Error("has no " + kind + " in phase " + phase, name());
  return found->second.at(kind);
}

std::string Measured::name() const {
  std::ostringstream text;
  text << envs << " x " << agents << ", " << actors << (actors == 1 ? " actor" : " actors");
  if (dimension != 64) text << ", " << dimension << " features";
  if (agent != "place_filter") text << ", " << agent;
  if (!observing.empty()) text << ", " << observing;
  if (dashboard) text << ", dashboard";
  if (encoder) text << ", encoder";
  if (ports) text << ", ports";
  return text.str();
}

namespace {

using Lines = std::map<std::string, std::map<std::string, std::map<std::string, std::vector<Used>>>>;

/// `all`: each case once; `lines`: by case, phase and kind.
void read_file(const std::string& path, std::vector<Measured>& all, Lines& lines) {
  std::ifstream in(path);
  if (!in) throw Error("cannot be read", path, "bench_scale writes it");
  const auto split = [](const std::string& line) {
    std::vector<std::string> cells;
    std::istringstream text(line);
    for (std::string cell; std::getline(text, cell, ',');) cells.push_back(cell);
    return cells;
  };
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> columns = split(line);
  for (int number = 2; std::getline(in, line); ++number) {
    const std::vector<std::string> cells = split(line);
    const std::string where = path + ":" + std::to_string(number);
    if (cells.size() != columns.size())
      throw Error("has " + std::to_string(cells.size()) + " columns, not " + std::to_string(columns.size()), where);
    Measured m;
    std::string phase, kind;
    Used used;
    const std::map<std::string, std::string*> words = {{"middleware", &m.middleware},
                                                       {"agent", &m.agent},
                                                       {"observing", &m.observing},
                                                       {"phase", &phase},
                                                       {"kind", &kind}};
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (const auto word = words.find(columns[i]); word != words.end()) {
        *word->second = cells[i];
        continue;
      }
      try {
        used.values[columns[i]] = std::stod(cells[i]);
      } catch (const std::logic_error&) {
        throw Error("'" + cells[i] + "' is no number", where + ", " + columns[i]);
      }
    }
    m.envs = static_cast<int>(used["envs"]), m.agents = static_cast<int>(used["agents"]);
    m.actors = static_cast<int>(used["actors"]), m.dimension = static_cast<int>(used["dimension"]);
    m.update = static_cast<int>(used["update"]), used.count = static_cast<int>(used["count"]);
    m.dashboard = used["dashboard"] != 0, m.encoder = used["encoder"] != 0, m.ports = used["ports"] != 0;
    const auto same = [&](const Measured& other) { return other.name() == m.name(); };
    if (std::none_of(all.begin(), all.end(), same)) all.push_back(m);
    lines[m.name()][phase][kind].push_back(used);
  }
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

const std::set<std::string> kPerSecond = {"busy_cores", "idle_cores", "received_per_s", "repeated_per_s",
                                          "resent_per_s"};

}  // namespace

std::vector<Measured> read_measured(const std::vector<std::string>& paths) {
  std::vector<Measured> all;
  Lines lines;
  for (const std::string& path : paths) read_file(path, all, lines);
  for (Measured& m : all)
    for (const auto& [phase, kinds] : lines[m.name()])
      for (const auto& [kind, each] : kinds) {
        Used& used = m.phases[phase][kind] = each.front();
        // Runs go at different speeds, as others leave them more or less of the machine: what is per second is compared
        // per step.
        const auto speed = [&](const Used& one, const std::string& column) {
          const bool per_second = kPerSecond.contains(column) && phase == "run";
          return per_second ? one["steps_per_s"] : 1.0;
        };
        const auto median_of = [&](const std::string& column) {
          std::vector<double> values;
          for (const Used& one : each) values.push_back(one[column] / speed(one, column));
          return median(values);
        };
        used.values["steps_per_s"] = median_of("steps_per_s");
        for (auto& [column, value] : used.values)
          if (column != "steps_per_s") value = median_of(column) * speed(used, column);
      }
  return all;
}

bool simulated(const Measured& m) {
  return m.ran() && m.actors > 0 && !m.dashboard && !m.encoder && m.dimension == 64 && m.observing.empty();
}

namespace {

using Vector = Eigen::VectorXd;

/// x >= 0 with the least |A x - b|^2, by coordinate descent: each step is exact, and the problem is convex.
Vector nonnegative_least_squares(const Eigen::MatrixXd& a, const Vector& b) {
  // Columns of one length, so that steps are alike.
  const Vector scale = a.colwise().norm().transpose().cwiseMax(1e-300);
  const Eigen::MatrixXd normal =
      (a * scale.cwiseInverse().asDiagonal()).transpose() * (a * scale.cwiseInverse().asDiagonal());
  const Vector right = scale.cwiseInverse().asDiagonal() * (a.transpose() * b);
  Vector x = Vector::Zero(a.cols());
  for (int sweep = 0; sweep < 200000; ++sweep) {
    double moved = 0;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      if (normal(i, i) <= 0) continue;
      const double to = std::max(0.0, x[i] + (right[i] - normal.row(i).dot(x)) / normal(i, i));
      moved = std::max(moved, std::abs(to - x[i]));
      x[i] = to;
    }
    if (moved < 1e-12 * x.cwiseAbs().maxCoeff()) break;
  }
  return scale.cwiseInverse().asDiagonal() * x;
}

/// Unknowns of the messages, then those of what is computed.
enum Unknown {
  kSend,
  kSendByte,
  kReceive,
  kReceiveByte,
  kTake,
  kTakeByte,
  kWakeMiddleware,
  kWake,
  kEnvTick,
  kEnvAgent,
  kActorTick,
  kActorAgent,
  kActorHelper,
  kUpdateStep,
  kUpdate,
  kUpdateHelper,
  kUnknowns
};

std::vector<double*> fields(Costs& c) {
  std::vector<double*> all(kUnknowns);
  all[kSend] = &c.send, all[kSendByte] = &c.send_byte;
  all[kReceive] = &c.receive, all[kReceiveByte] = &c.receive_byte;
  all[kTake] = &c.take, all[kTakeByte] = &c.take_byte;
  all[kWakeMiddleware] = &c.wake_middleware, all[kWake] = &c.wake;
  all[kEnvTick] = &c.env_tick, all[kEnvAgent] = &c.env_agent;
  all[kActorTick] = &c.actor_tick, all[kActorAgent] = &c.actor_agent, all[kActorHelper] = &c.actor_helper;
  all[kUpdateStep] = &c.update_step, all[kUpdate] = &c.update, all[kUpdateHelper] = &c.update_helper;
  return all;
}

struct Equation {
  Vector terms = Vector::Zero(kUnknowns);
  double seconds = 0;  // of a processor, per second
};

/// What one service of `kind` used, as a sum of costs. `main`: by its own thread, else by the middleware's.
Equation equation(const Measured& m, const std::string& kind, bool main) {
  const Used& used = m.used("run", kind);
  const double steps = used["steps_per_s"], ticks = steps / (m.envs * m.agents);  // of one env_service
  Equation e;
  e.seconds = used[main ? "main_us" : "others_us"] * 1e-6 * steps;
  const double received = used["received_per_s"], received_bytes = used["received_bytes"] * steps;
  if (!main) {
    e.terms[kReceive] = received;
    e.terms[kReceiveByte] = received_bytes;
    e.terms[kWakeMiddleware] = used["others_sleeps"] * steps;
    if (kind == "actor") e.terms[kActorHelper] = steps / m.actors;
    if (kind == "learner") e.terms[kUpdateHelper] = steps;
    return e;
  }
  e.terms[kSend] = used["sent_datagrams"] * steps;
  e.terms[kSendByte] = used["sent_bytes"] * steps;
  e.terms[kTake] = received;
  e.terms[kTakeByte] = received_bytes;
  e.terms[kWake] = used["main_sleeps"] * steps;
  if (kind == "env") {
    e.terms[kEnvTick] = ticks;
    e.terms[kEnvAgent] = ticks * m.agents;
  } else if (kind == "actor") {
    e.terms[kActorTick] = ticks * m.envs / m.actors;
    e.terms[kActorAgent] = ticks * m.agents * m.envs / m.actors;
  } else {
    Layout layout;
    set_agent(layout, m.agent, m.update);
    e.terms[kUpdateStep] = steps;
    e.terms[kUpdate] = steps / (layout.batch * layout.steps);
  }
  return e;
}

std::vector<Equation> equations(const std::vector<Measured>& cases) {
  std::vector<Equation> all;
  for (const Measured& m : cases)
    for (const char* kind : {"env", "actor", "learner"})
      for (const bool main : {true, false}) all.push_back(equation(m, kind, main));
  return all;
}

/// Fits the unknowns from `first` on; the others are as they are in `costs`.
Costs fit(const std::vector<Equation>& all, Costs costs, int first) {
  const int count = kUnknowns - first;
  Eigen::MatrixXd a(static_cast<Eigen::Index>(all.size()), count);
  Vector b(static_cast<Eigen::Index>(all.size())), known(kUnknowns);
  const std::vector<double*> to = fields(costs);
  for (int i = 0; i < kUnknowns; ++i) known[i] = *to[static_cast<std::size_t>(i)];
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    a.row(row) = all[i].terms.tail(count).transpose() / all[i].seconds;
    b[row] = 1 - all[i].terms.head(first).dot(known.head(first)) / all[i].seconds;
  }
  const Vector x = nonnegative_least_squares(a, b);
  for (int i = 0; i < count; ++i) *to[first + i] = x[i];
  return costs;
}

/// What each service has every second without any training, and for each other one.
template <class Value>
std::pair<double, double> idle_line(const std::vector<Measured>& cases, const Value& value) {
  std::vector<std::pair<double, double>> idle;  // others, value
  for (const Measured& m : cases)
    if (m.phases.contains("idle"))
      for (const auto& [kind, used] : m.phases.at("idle")) idle.emplace_back(m.envs + m.actors - 1, value(used));
  if (idle.empty()) return {};
  Eigen::MatrixXd a(static_cast<Eigen::Index>(idle.size()), 2);
  for (std::size_t i = 0; i < idle.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    a(row, 0) = 1 / idle[i].second;
    a(row, 1) = idle[i].first / idle[i].second;
  }
  const Vector x = nonnegative_least_squares(a, Vector::Ones(a.rows()));
  return {x[0], x[1]};
}

}  // namespace

Costs calibrate(const std::vector<Measured>& cases) {
  if (cases.empty()) throw Error("no case to calibrate by");
  Costs costs = fit(equations(cases), {}, 0);
  std::tie(costs.background, costs.background_other) =
      idle_line(cases, [](const Used& used) { return (used["main_us"] + used["others_us"]) * 1e-6; });
  std::tie(costs.background_sent, costs.background_sent_other) =
      idle_line(cases, [](const Used& used) { return used["sent_bytes"]; });
  return costs;
}

Costs calibrate_agent(const std::vector<Measured>& cases, Costs costs) {
  costs.actor_tick = costs.actor_agent = costs.actor_helper = 0;
  costs.update_step = costs.update = costs.update_helper = 0;
  std::vector<Equation> all;
  for (const Measured& m : cases)
    for (const char* kind : {"actor", "learner"})
      for (const bool main : {true, false}) all.push_back(equation(m, kind, main));
  return fit(all, costs, kActorTick);
}

namespace {

/// Ethernet, IP, UDP and RTPS around a message: a datagram goes in pieces of 1,500 bytes.
double on_the_wire(double payload) {
  constexpr double kRtps = 20 + 12 + 24 + 32;  // header, time, DATA, HEARTBEAT
  const double datagram = payload + kRtps + 8;
  return datagram + 34 * std::ceil(datagram / 1480);
}

template <class Message>
double size_of(Message& message) {
  message.header().session("scale");
  message.header().sender("actor-0");
  Bytes bytes;
  encode(message, bytes);
  return on_the_wire(static_cast<double>(bytes.size()));
}

}  // namespace

Sizes sizes_of(const std::string& agent, int agents, int dimension, int frames) {
  const auto m = static_cast<std::size_t>(agents);
  const auto d = static_cast<std::size_t>(dimension);
  NetworkTask task;
  task.features = dimension;
  task.frames = frames;
  task.reference = Matrix<float>::Random(dimension, frames);
  const auto& entry = NetworkRegistry<float>::instance().find("network", agent);
  const auto network = entry.create(Parameters("network " + agent, entry.parameters, {}), task);
  Layout layout;
  set_agent(layout, agent, 16);
  const auto steps = static_cast<std::size_t>(layout.steps);

  Sizes sizes;
  msg::Observation observation;
  observation.traversal("summer");
  for (auto* each : {&observation.frame(), &observation.position(), &observation.goal()}) each->resize(m);
  for (auto* each : {&observation.previous_action(), &observation.allowed(), &observation.flags()}) each->resize(m);
  observation.reward().resize(m);
  // Larger ones go by reference.
  if (m * d * sizeof(float) <= kLargestWhole) observation.features().resize(m * d);
  observation.feature_dimension() = observation.features().empty() ? 0 : static_cast<std::uint32_t>(d);
  observation.by_reference() = observation.features().empty() && d > 0;
  sizes.observation = size_of(observation);
  msg::Action action;
  action.environment("env-0");
  action.choice().resize(m);
  sizes.action = size_of(action);
  msg::Trajectory t;
  t.learner("policy");
  t.environment("env-0");
  t.feature_dimension() = static_cast<std::uint32_t>(d);
  t.state().resize(static_cast<std::size_t>(network->state_size()));
  t.shown().resize(steps + 1), t.position().resize(steps + 1), t.goal().resize(steps + 1), t.value().resize(steps + 1);
  t.previous_action().resize(steps + 1), t.allowed().resize(steps + 1), t.first().resize(steps + 1);
  t.features().resize((steps + 1) * d);
  t.action().resize(steps), t.log_probability().resize(steps), t.reward().resize(steps), t.ended().resize(steps);
  t.final_value().resize(steps);
  sizes.trajectory = size_of(t);
  msg::TrajectoryAcknowledgement acknowledgement;
  acknowledgement.actor("actor-0");
  sizes.acknowledgement = size_of(acknowledgement);
  const std::size_t parameters = static_cast<std::size_t>(network->parameter_count()) * sizeof(float);
  sizes.chunks = static_cast<int>(chunk_count(parameters));
  msg::PolicyParameters chunk;
  chunk.agent(agent);
  chunk.data().resize(parameters / static_cast<std::size_t>(sizes.chunks));
  sizes.chunk = size_of(chunk);
  msg::EpisodeStat episode;
  episode.traversal("summer");
  episode.policy(agent);
  episode.path().resize(12);
  sizes.episode = size_of(episode);
  msg::EpisodeAcknowledgement confirmation;
  confirmation.environment("env-0");
  sizes.episode_acknowledgement = size_of(confirmation);
  return sizes;
}

void set_agent(Layout& layout, const std::string& agent, int trainer_agents) {
  const auto& recommended = NetworkRegistry<float>::instance().find("network", agent).recommended;
  const auto value = [&](const char* name) {
    const auto found = recommended.find(name);
    return found == recommended.end() ? 64 : static_cast<int>(found->second);
  };
  layout.steps = value("sequence");
  layout.batch = trainer_agents * value("segment") / value("sequence");
}

Layout layout_of(const Measured& m) {
  const Used& any = m.used("run", "env");
  Layout layout;
  layout.envs = m.envs, layout.agents = m.agents, layout.actors = m.actors;
  layout.cores = any["busy_cores"] + any["idle_cores"];
  layout.episodes = any["episodes_per_step"];
  set_agent(layout, m.agent, m.update);
  return layout;
}

}  // namespace citylearn::scale
