// SPDX-License-Identifier: Apache-2.0
#include "env_service/environment.h"

#include <algorithm>
#include <numeric>

#include "core/task/goal_chain.h"
#include "core/task/path.h"
#include "core/wire/observation_size.h"

namespace citylearn {

namespace {

// Steps and tasks are counted in int.
constexpr std::uint32_t kMaxCount = 1u << 30;
constexpr int kMaxTries = 1000;  // to draw a goal that can be reached
constexpr int kMaxStarts = 5;    // to begin where there is one

std::uint8_t flags_of(const AgentState& agent) {
  return static_cast<std::uint8_t>(agent.flags + kLaterGoal * agent.later.size());
}

}  // namespace

Environment::Environment(const Traversal& traversal, int agents, const Imperfections& imperfections, int goals)
    : traversal_(traversal),
      traversal_hash_(traversal.hash()),
      imperfections_(imperfections),
      goals_(goals),
      announced_agents_(agents),
      streets_(traversal.states()) {
  if (agents < 1 || agents > static_cast<int>(msg::MAX_AGENTS))
    throw Error("must be 1.." + std::to_string(msg::MAX_AGENTS) + ", is " + std::to_string(agents), "agents");
  agents_.resize(agents);
}

std::span<const float> Environment::feature(int frame) const {
  const auto dimension = static_cast<std::size_t>(traversal_.dimension);
  return std::span(traversal_.features).subspan(static_cast<std::size_t>(frame) * dimension, dimension);
}

void Environment::reset(const msg::TaskSettings& settings) {
  const std::uint64_t end = std::uint64_t{settings.first_frame()} + settings.frames();
  if (settings.frames() < 2) throw Error("a route needs at least 2 frames", "TaskSettings.frames");
  if (end > static_cast<std::uint64_t>(traversal_.frames))
    throw Error("the route ends at frame " + std::to_string(end) + ", traversal '" + traversal_.name + "' has only " +
                    std::to_string(traversal_.frames),
                "TaskSettings.frames", "ask for a shorter route");
  const auto require_count = [](std::uint32_t value, const char* where) {
    if (value < 1 || value > kMaxCount)
      throw Error("must be 1.." + std::to_string(kMaxCount) + ", is " + std::to_string(value), where);
  };
  require_count(settings.max_steps(), "TaskSettings.max_steps");
  if (settings.task_mode() == msg::IDLE) throw Error("there is no task in mode IDLE", "TaskSettings.task_mode");
  if (settings.task_mode() == msg::EVALUATE) {
    require_count(settings.tasks(), "TaskSettings.tasks");
    if (settings.first_task() > kMaxCount - settings.tasks())
      throw Error("the last task would be over " + std::to_string(kMaxCount), "TaskSettings.first_task");
  }
  std::size_t most = 0;  // in an evaluation: as many as it has tasks, within what is allowed and fits one datagram
  if (settings.task_mode() == msg::EVALUATE)
    most = std::min<std::size_t>(settings.tasks(), static_cast<std::size_t>(evaluation_agents_));
  if (!settings.by_reference() && traversal_.dimension > 0)
    most = std::min(most, kMaxWholeBytes / sizeof(float) / static_cast<std::size_t>(traversal_.dimension));
  const int count = std::max(announced_agents_, static_cast<int>(most));
  if (!settings.by_reference() && std::int64_t{count} * traversal_.dimension > std::int64_t{msg::MAX_FEATURES})
    throw Error("the features of " + std::to_string(count) + " agents x " + std::to_string(traversal_.dimension) +
                    " do not fit one observation (at most " + std::to_string(msg::MAX_FEATURES) + ")",
                "TaskSettings.by_reference", "ask for observations by reference, or host fewer agents");
  if (streets_ && (settings.frames() != static_cast<std::uint32_t>(traversal_.frames) || settings.shuffle()))
    throw Error(settings.shuffle() ? "the frames of streets are not shuffled"
                                   : "the streets of '" + traversal_.name + "' are one route of all " +
                                         std::to_string(traversal_.frames) + " frames",
                settings.shuffle() ? "TaskSettings.shuffle" : "TaskSettings.frames", "ask for all of them in order");
  if (!traversal_.unmatched.empty()) {
    const auto begin = traversal_.unmatched.begin() + settings.first_frame();
    if (std::count(begin, begin + settings.frames(), false) < 2)
      throw Error("traversal '" + traversal_.name + "' shows fewer than 2 places of the route", "TaskSettings.frames",
                  "ask for another part of it");
  }
  if (!streets_ && traversal_.goal >= 0 &&
      (traversal_.goal < static_cast<int>(settings.first_frame()) || traversal_.goal >= static_cast<int>(end)))
    throw Error("the route " + std::to_string(settings.first_frame()) + ".." + std::to_string(end - 1) +
                    " is without the goal, place " + std::to_string(traversal_.goal),
                "TaskSettings.frames", "ask for another part of the traversal");
  settings_ = settings;
  map_ = streets_ ? streets_ : std::make_shared<const StateMap>(static_cast<int>(settings.frames()));
  fields_.emplace(*map_, settings.goal_radius());
  step_ = 0;
  finished_.clear();
  agents_.resize(static_cast<std::size_t>(count));
  finished_.reserve(agents_.size());
  const int frames = static_cast<int>(settings.frames());
  for (int index = 0; index < agents(); ++index) {
    AgentState& agent = agents_[index];
    agent = AgentState{};
    if (settings.shuffle()) {
      agent.order.resize(frames);
      std::iota(agent.order.begin(), agent.order.end(), 0);
    }
    agent.random = Random{settings.seed(), static_cast<std::uint64_t>(index)};
    if (settings.task_mode() == msg::EVALUATE) {
      begin_task(agent, static_cast<int>(settings.first_task()) + index);
    } else {
      agent.mishaps = Mishaps(imperfections_, settings.seed(), static_cast<std::uint64_t>(index));
      agent.frame = state_to_begin(agent);
      begin_episode(agent);
    }
  }
}

/// Returns the place of the route that is nearest to a place of the traversal.
int Environment::on_route(int place) const {
  return std::clamp(place - static_cast<int>(settings_.first_frame()), 0, static_cast<int>(settings_.frames()) - 1);
}

bool Environment::is_unmatched(int place) const {
  return !traversal_.unmatched.empty() &&
         traversal_.unmatched[settings_.first_frame() + static_cast<std::size_t>(place)];
}

/// Draws the state in which an agent begins: where all tasks lead to one place, one that leads there. A robot begins
/// where it stands.
int Environment::state_to_begin(AgentState& agent) {
  int drawn;
  for (int tries = 0;; ++tries) {
    drawn = static_cast<int>(agent.random.below(streets_ ? streets_->starts().size() : settings_.frames()));
    if (streets_) drawn = streets_->starts()[static_cast<std::size_t>(drawn)];
    if (!is_unmatched(drawn) && (traversal_.goal < 0 || leads(drawn, on_route(traversal_.goal)))) break;
    if (traversal_.goal >= 0 && tries == kMaxTries)
      throw Error("hardly any start leads to place " + std::to_string(traversal_.goal), "--goal-place",
                  "choose another one, or a lower goal radius");
  }
  return robot_ ? on_route(robot_->place) : drawn;
}

/// Returns whether the goal, a place, can be reached from a state that is not there.
bool Environment::leads(int state, int goal) {
  const DistanceField distance = fields_->to(goal);
  return distance.reaches(state) && distance(state) > 0;
}

int Environment::goal(int agent) const {
  return static_cast<int>(settings_.first_frame()) + agents_[static_cast<std::size_t>(agent)].goal;
}

std::pair<int, int> Environment::way(int agent, std::uint8_t action) const {
  const int here = agents_[static_cast<std::size_t>(agent)].frame, first = static_cast<int>(settings_.first_frame());
  return {first + here, first + (action < kActions ? map_->after(here, action, 1) : here)};
}

/// Returns the place to which the robot is sent, or draws one that can be reached and is not where the agent stands.
int Environment::goal_to_begin(AgentState& agent) {
  if (external_goals_) return on_route(*std::exchange(next_goal_, std::nullopt));
  if (traversal_.goal >= 0) return on_route(traversal_.goal);
  const int here = map_->place(agent.frame);
  for (int tries = 0;; ++tries) {
    int drawn = static_cast<int>(agent.random.below(static_cast<std::uint64_t>(map_->places()) - 1));
    if (drawn >= here) ++drawn;
    if (streets_ ? leads(agent.frame, drawn) : !is_unmatched(drawn)) return drawn;
    if (streets_ && tries == kMaxTries)
      throw Error("finds no goal that can be reached from place " + std::to_string(here),
                  "traversal '" + traversal_.name + "'",
                  "leave out places without a way, or choose a lower goal radius");
  }
}

void Environment::begin_episode(AgentState& agent) {
  agent.previous_action = kNoAction;
  // One observation ends an episode and begins the next at the same place, so both have the same picture.
  bool goes_on = agent.flags != 0 && settings_.task_mode() == msg::TRAIN;
  if (goes_on && traversal_.goal >= 0 && !leads(agent.frame, on_route(traversal_.goal))) {
    agent.frame = state_to_begin(agent);  // from the goal of all tasks; what ends the episode shows this place
    goes_on = false;
  }
  if (external_goals_ && !next_goal_) {
    agent.flags |= msg::FLAG_IDLE;
    if (!goes_on) look(agent);
    return;
  }
  const int frames = static_cast<int>(settings_.frames());
  for (int tries = 1;; ++tries) {
    agent.start = agent.frame;
    try {
      agent.later = draw_goals(*map_, *fields_, agent.start, goal_to_begin(agent), goals_,
                               [this](int place) { return streets_ || !is_unmatched(place); });
      break;
    } catch (const Error&) {  // it may stand in a part of the streets that has no way out
      if (external_goals_ || tries == kMaxStarts) throw;
      agent.frame = state_to_begin(agent);
      goes_on = false;
    }
  }
  agent.fewest = fewest_steps(*map_, *fields_, settings_.goal_radius(), agent.start, agent.later);
  std::reverse(agent.later.begin(), agent.later.end());
  std::uint64_t limit = std::min(std::uint64_t{settings_.max_steps()} * agent.later.size(), std::uint64_t{kMaxCount});
  if (settings_.max_detour() > 0)
    limit = std::min(limit, std::uint64_t{settings_.max_detour()} * static_cast<std::uint64_t>(agent.fewest));
  agent.rule = {0, static_cast<int>(limit)};
  aim(agent);
  agent.steps = 0;
  agent.episode_reward = 0;
  agent.path.clear();
  agent.strayed = false;
  agent.flags |= msg::FLAG_FIRST;
  if (settings_.shuffle()) {
    // From the identity, so that under EVALUATE the order is the task's alone and not of those the agent did before.
    const int here = agent.order[agent.frame];
    std::iota(agent.order.begin(), agent.order.end(), 0);
    for (int i = frames - 1; i > 0; --i) std::swap(agent.order[i], agent.order[agent.random.below(i + 1)]);
    if (goes_on) std::swap(agent.order[agent.frame], *std::find(agent.order.begin(), agent.order.end(), here));
  }
  agent.mishaps.plan_kidnappings(agent.fewest);
  if (!goes_on) look(agent);
}

/// Gives the agent the next of its goals.
void Environment::aim(AgentState& agent) {
  agent.goal = agent.later.back();
  agent.later.pop_back();
  agent.distance = fields_->to(agent.goal);
  agent.rule.aim(agent.distance(agent.frame));
}

void Environment::begin_task(AgentState& agent, int task) {
  agent.task = task;
  if (task >= static_cast<int>(settings_.first_task() + settings_.tasks())) {
    agent.flags |= msg::FLAG_IDLE;
    agent.later.clear();
    agent.previous_action = kNoAction;
    return;
  }
  // The task is drawn from (seed, task) alone, so every policy evaluated with this seed gets the same tasks, and the
  // same mishaps at the same steps.
  agent.random = Random{settings_.seed(), static_cast<std::uint64_t>(task)};
  agent.mishaps = Mishaps(imperfections_, settings_.seed(), static_cast<std::uint64_t>(task));
  agent.frame = state_to_begin(agent);
  begin_episode(agent);
}

void Environment::check(std::span<const std::uint8_t> actions) const {
  if (actions.size() != agents_.size())
    throw Error(std::to_string(actions.size()) + " actions for " + std::to_string(agents_.size()) + " agents",
                "Action.choice");
  for (int index = 0; index < agents(); ++index) {
    const AgentState& agent = agents_[index];
    if (agent.flags & msg::FLAG_IDLE || waits(agent, actions[index])) continue;
    if (actions[index] >= kActions || map_->next(agent.frame, actions[index]) < 0)
      throw Error("action " + std::to_string(actions[index]) + " is not allowed at frame " +
                      std::to_string(settings_.first_frame() + agent.frame),
                  "Action.choice[" + std::to_string(index) + "]", "the observation's `allowed` says which are");
  }
}

void Environment::step(std::span<const std::uint8_t> actions) {
  check(actions);
  ++step_;
  finished_.clear();
  const int first = static_cast<int>(settings_.first_frame());
  for (int index = 0; index < agents(); ++index) {
    AgentState& agent = agents_[index];
    if (agent.flags & msg::FLAG_IDLE) {
      agent.reward = 0;
      const bool begins = next_goal_ && awaits_goal();
      agent.flags = begins ? 0 : msg::FLAG_IDLE;
      if (begins) {
        agent.frame = state_to_begin(agent);
        begin_episode(agent);
      }
      continue;
    }
    if (waits(agent, actions[index])) {
      agent.flags = msg::FLAG_FIRST;
      agent.reward = 0;
      continue;
    }
    move(agent, actions[index]);
    ++agent.steps;
    const bool fits = path_octets(agent.steps) <= msg::MAX_PATH;  // an EpisodeStat
    if (fits) append_action(agent.path, agent.steps - 1, actions[index]);
    agent.previous_action = actions[index];
    agent.flags = 0;
    agent.reward = agent.rule.step(agent.distance(agent.frame));
    const bool reached = agent.rule.reached() && agent.later.empty();
    const bool goes_on = !reached && !agent.rule.out_of_steps() && !next_goal_;
    agent.episode_reward += agent.reward;
    if (goes_on && agent.rule.reached())
      aim(agent);
    else if (goes_on)
      kidnap(agent);
    if (!agent.mishaps.frame_dropped()) look(agent);
    if (goes_on) continue;
    const int goal = agent.later.empty() ? agent.goal : agent.later.front();
    finished_.push_back({index, agent.task, first + agent.start, first + goal, agent.steps, agent.fewest,
                         agent.episode_reward, reached,
                         fits && !agent.strayed ? agent.path : std::vector<std::uint8_t>()});
    agent.flags = reached ? msg::FLAG_TERMINATED : msg::FLAG_TRUNCATED;
    if (settings_.task_mode() == msg::EVALUATE) {
      begin_task(agent, agent.task + agents());
    } else {
      begin_episode(agent);
    }
  }
}

void Environment::observe(msg::Observation& observation) const {
  const std::size_t count = agents_.size();
  const std::uint32_t first = settings_.first_frame();
  observation.settings() = settings_.settings();
  observation.step() = step_;
  observation.traversal() = traversal_.name.c_str();
  observation.traversal_hash() = traversal_hash_;
  const std::size_t dimension = settings_.by_reference() ? 0 : static_cast<std::size_t>(traversal_.dimension);
  observation.by_reference() = settings_.by_reference();
  observation.feature_dimension() = static_cast<std::uint32_t>(dimension);
  observation.frame().resize(count);
  observation.position().resize(count);
  observation.goal().resize(count);
  observation.previous_action().resize(count);
  observation.allowed().resize(count);
  observation.flags().resize(count);
  observation.reward().resize(count);
  observation.features().resize(count * dimension);
  for (std::size_t index = 0; index < count; ++index) {
    const AgentState& agent = agents_[index];
    observation.frame()[index] = first + agent.shown;
    observation.position()[index] = first + agent.frame;
    observation.goal()[index] = first + agent.goal;
    observation.previous_action()[index] = agent.previous_action;
    observation.allowed()[index] = map_->allowed(agent.frame);
    observation.flags()[index] = flags_of(agent);
    observation.reward()[index] = agent.reward;
    if (dimension == 0) continue;
    const std::span<const float> features = feature(static_cast<int>(first) + agent.shown);
    std::copy(features.begin(), features.end(), observation.features().begin() + index * dimension);
  }
}

void Environment::observe(msg::Scene& scene) const {
  const std::size_t count = agents_.size();
  const std::uint32_t first = settings_.first_frame();
  scene.step() = step_;
  scene.frame().resize(count);
  scene.position().resize(count);
  scene.start().resize(count);
  scene.goal().resize(count);
  scene.steps().resize(count);
  scene.flags().resize(count);
  for (std::size_t index = 0; index < count; ++index) {
    const AgentState& agent = agents_[index];
    scene.frame()[index] = first + agent.shown;
    scene.position()[index] = first + agent.frame;
    scene.start()[index] = first + agent.start;
    scene.goal()[index] = first + agent.goal;
    scene.steps()[index] = static_cast<std::uint32_t>(agent.steps);
    scene.flags()[index] = flags_of(agent);
  }
}

void Environment::move(AgentState& agent, std::uint8_t action) {
  const int intended = map_->next(agent.frame, action);
  agent.frame = map_->after(agent.frame, action, agent.mishaps.times_done());
  if (robot_) agent.frame = on_route(robot_->place);
  agent.strayed = agent.strayed || agent.frame != intended;
}

/// Carries the agent to another state from which it can reach its goal, when it is time to.
void Environment::kidnap(AgentState& agent) {
  if (!agent.mishaps.kidnapped()) return;
  std::vector<int> excluded;
  for (int state = 0; state < map_->states(); ++state)
    if (state == agent.frame || !agent.distance.reaches(state) || agent.distance(state) == 0) excluded.push_back(state);
  const int state = agent.mishaps.state_kidnapped_to(excluded, map_->states());
  if (state < 0) return;
  agent.frame = state;
  agent.rule.displace(agent.distance(state));
  agent.mishaps.await_kidnapping(agent.distance(state));
  agent.strayed = true;
}

/// Shows the agent the frame of the place where it stands.
void Environment::look(AgentState& agent) const {
  agent.shown = settings_.shuffle() ? agent.order[agent.frame] : agent.frame;
  if (robot_) agent.shown = robot_->frame - static_cast<int>(settings_.first_frame());
}

bool Environment::awaits_goal() const {
  const AgentState& robot = agents_.front();
  if (!external_goals_ || !(robot.flags & msg::FLAG_IDLE)) return false;
  return settings_.task_mode() != msg::EVALUATE ||
         robot.task < static_cast<int>(settings_.first_task() + settings_.tasks());
}

bool Environment::done() const {
  for (const AgentState& agent : agents_)
    if (!(agent.flags & msg::FLAG_IDLE)) return false;
  return settings_.task_mode() == msg::EVALUATE && !awaits_goal();
}

}  // namespace citylearn
