// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "policy_service/ranks/coordinator.h"
#include "policy_service/ranks/rank_group.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using std::chrono::milliseconds;

constexpr int kRanks = 4, kKillsOfEach = 10;
constexpr int kContinuation = 3000;  // ms in which all survivors have made an update without the killed one
const std::string kRendezvous = "rendezvous";

struct RankProcess;

/// Client and server are the sides 0 and 1.
struct Connection {
  std::array<RankProcess*, 2> ends;
  std::array<int, 2> arrives{};                 // the last message to a side: they keep their order
  std::array<bool, 2> open{true, true}, cut{};  // to a side that is cut, what is on its way is lost
};

/// An update that counted, after those before it.
struct Update {
  int before = 0, count = 0;
  std::vector<int> works;
};

/// Processes of ranks in virtual milliseconds. Each rank in turn is killed and starts again with nothing. A history is
/// the number of the newest update. Processes that made the same updates in the same order have the same history.
struct World {
  explicit World(std::uint64_t seed) : random(seed) {}
  void run();
  int pick(int low, int high) { return low + static_cast<int>(random() % static_cast<std::uint64_t>(high - low + 1)); }
  void after(int delay, std::function<void()> event) { events[{now + delay, ++event_count}] = std::move(event); }
  Clock::time_point time() const { return Clock::time_point(milliseconds(now)); }
  void check(bool right, const std::string& what) {
    if (!right && fault.empty()) fault = "at " + std::to_string(now) + " ms: " + what;
  }
  RankProcess& process(int number) { return *processes.at(static_cast<std::size_t>(number)); }
  const Update& update(int history) const { return updates.at(static_cast<std::size_t>(history)); }
  void start(int rank);
  void kill(bool pair_ends = false);
  int connect(RankProcess& client, const std::string& address);
  void send(int connection, int side, const Json& message);  // null: closes it
  int add(int before, const std::vector<int>& works);
  void counted(RankProcess& process);

  std::mt19937_64 random;
  int now = 0;
  std::uint64_t event_count = 0;
  std::map<std::pair<int, std::uint64_t>, std::function<void()>> events;
  std::vector<std::unique_ptr<RankProcess>> processes;  // by number, which is incarnation and address too
  std::deque<Connection> connections;
  RankProcess* front = nullptr;  // listens at the rendezvous
  std::vector<Update> updates{1};
  std::map<std::pair<int, std::vector<int>>, int> known_updates;
  std::map<std::pair<std::string, std::uint64_t>, std::map<int, bool>> outcomes;  // of meetings, by process
  std::map<std::pair<std::string, std::uint64_t>, std::set<int>> adding;          // processes, by meeting
  int works = 0, kills = 0, victim = -1, killed_at = 0, slowest = 0;
  bool next_is_due = false, waits_for_decision = false;
  std::set<int> to_continue;  // survivors that made no update yet without the killed one
  std::string fault, log;
};

/// A real Coordinator, and a model of the rest: roster_thread.cc, shared_updates.cc and, as to its outcome, gloo.
struct RankProcess {
  RankProcess(World& all, int own_rank, int own_number) : world(all), rank(own_rank), number(own_number) { learn(); }
  void later(int delay, std::function<void()> event) {
    world.after(delay, [this, event = std::move(event)] {
      if (alive) event();
    });
  }

  // The learner. Its work is a number that stands for the steps that it learned from.
  void learn() {
    work = world.works++;
    later(world.pick(20, 80), [this] { arrive(); });
  }
  void arrive() { ask({{"type", "arrive"}, {"updates", updates}, {"work", work}, {"history", history}}); }
  void meet(const Json& message) {
    meeting = message;
    called_by = coordinator_incarnation;
    world.adding[{called_by, seen}].insert(number);
    add(world.now + 2000);
  }
  /// A sum begins when all are there. A member that is killed before its end ends it.
  void add(int deadline) {
    const auto& attendees = meeting.at("attendees");
    if (lacks_any() || world.now > deadline) return vote(false);
    if (world.adding[{called_by, meeting.at("meeting")}].size() < attendees.size())
      return later(1, [this, deadline] { add(deadline); });
    later(world.pick(5, 40), [this] { vote(!lacks_any()); });
  }
  void vote(bool yes) {
    has_sum = yes;
    ask({{"type", "vote"}, {"yes", yes}});
  }
  bool lacks_any() const {
    for (const Json& one : meeting.at("attendees"))
      if (!world.process(std::stoi(one.at("incarnation").get<std::string>())).alive) return true;
    return false;
  }
  void decided(bool yes) {
    if (!yes) return arrive();  // with the same work
    world.check(has_sum, "an update counts whose sum process " + name() + " does not have");
    RankMeeting all;
    for (const Json& one : meeting.at("attendees")) {
      if (one.at("incarnation") == name()) all.mine = all.members.size();
      all.members.push_back({one.at("rank"), one.at("updates"), one.at("newcomer"), ""});
    }
    all.leader = RankMeeting::leader_of(all.members);
    const int before = meeting.at("attendees").at(all.leader).at("history");
    std::vector<int> works;
    for (std::size_t i = 0; i < all.members.size(); ++i) {
      if (all.behind(i)) continue;
      works.push_back(meeting.at("attendees").at(i).at("work"));
      world.check(meeting.at("attendees").at(i).at("history") == before, "they add different histories");
    }
    // Work that did not count comes again until it does: only a process that starts may lose what it has.
    world.check(!all.behind(all.mine) || updates == 0, "process " + name() + " loses its work");
    updates = static_cast<int>(all.members[all.leader].updates) + 1;
    history = world.add(before, works);
    world.counted(*this);
    learn();
  }
  void ask(const Json& message) {
    question = message;
    awaited = message.at("type") == "vote" ? "decision" : "meeting";
    resend();
  }

  // The member.
  std::string name() const { return std::to_string(number); }
  void resend() {
    if (question.is_null() || link < 0 || !is_member) return;
    question["meeting"] = question["seen"] = seen;
    question["committed"] = committed;
    world.send(link, 1, question);
  }
  /// Ends a question. Returns whether the learner waits for this answer.
  bool answers(const std::string& type) {
    question = {};
    return awaited == type && !std::exchange(awaited, "").empty();
  }
  void drop_link() {
    if (link >= 0) world.send(std::exchange(link, -1), 1, {});
  }
  void lost_coordinator() {
    link = -1;
    if (!std::exchange(is_member, false)) return;
    candidates.assign(1, {coordinator_incarnation, false});
    std::erase_if(known, [&](const auto& one) { return one.second == coordinator_incarnation; });
    for (const auto& [one, incarnation] : known) candidates.emplace_back(incarnation, true);
  }
  void search() {
    std::pair<std::string, bool> next{kRendezvous, false};
    if (!candidates.empty()) {
      next = candidates.front();
      candidates.pop_front();
    } else if (world.now < next_search) {
      return;
    } else {
      next_search = world.now + 100;
    }
    link = world.connect(*this, next.first);
    if (link < 0) return;
    hello_deadline = world.now + 1200;
    Json expected = Json::array();
    for (const auto& [one, incarnation] : known) expected.push_back(incarnation);
    world.send(link, 1,
               {{"type", "hello"},
                {"protocol", kRankProtocol},
                {"rank", rank},
                {"ranks", kRanks},
                {"incarnation", name()},
                {"address", name()},
                {"identity", Json::object()},
                {"takeover", next.second},
                {"committed", committed},
                {"expected", expected}});
  }
  void take(const Json& message) {
    const std::string type = message.at("type");
    heard = world.now;
    if (type == "welcome") {
      is_member = true;
      candidates.clear();
      coordinator_incarnation = message.at("coordinator");
      kept = message.at("kept");
      if (!kept) {
        committed = seen = 0;
        if (!question.is_null() && question.at("type") == "vote" && answers("decision"))
          later(0, [this] { decided(false); });
      }
      resend();
    } else if (type == "redirect") {
      drop_link();
      is_member = false;
      candidates.assign(1, {message.at("address"), false});
    } else if (type == "members") {
      if (!kept) known.clear();
      for (const Json& one : message.at("members")) known[one.at("rank")] = one.at("incarnation");
    } else if (type == "meeting") {
      seen = message.at("meeting");
      known.clear();
      for (const Json& one : message.at("attendees")) known[one.at("rank")] = one.at("incarnation");
      kept = false;
      if (answers("meeting")) meet(message);
    } else if (type == "decision" && message.at("meeting") == seen) {
      const bool yes = message.at("yes");
      if (yes) committed = seen;
      for (const auto& [other, outcome] : world.outcomes[{called_by, seen}])
        world.check(!world.process(other).alive || outcome == yes,
                    "process " + name() + " believes another outcome than " + std::to_string(other));
      world.outcomes[{called_by, seen}][number] = yes;
      if (answers("decision")) decided(yes);
    } else {
      world.check(type != "refused", "refused");
    }
  }

  // The coordinator's process.
  struct Accepted {
    int since = 0;
    Json hello;
  };
  void take_first(int connection, const Json& message) {
    if (message.at("type") == "hello") {
      accepted[connection] = {world.now, message};
    } else if (message.at("type") != "probe") {
      coordinator.receive(connection, message, world.time());
    } else if (!coordinator.serving()) {
      if (is_member && message.at("address") != coordinator_incarnation)
        world.send(connection, 0, {{"type", "redirect"}, {"address", coordinator_incarnation}});
    } else if (coordinator.yields_to(message)) {
      coordinator.hand_over(message.at("address"));
    } else if (message.at("address") != name()) {
      world.send(connection, 0, {{"type", "absorb"}, {"address", name()}});
    }
  }
  void answer_waiting() {
    for (const bool own : {true, false})
      for (auto& [connection, one] : std::map<int, Accepted>(accepted)) {
        if (own != (one.hello.at("incarnation") == name())) continue;
        const int waits = world.now - one.since;
        if (own || coordinator.serving()) {
          coordinator.introduce(connection, one.hello, world.time());
        } else if (is_member && (!one.hello.at("takeover").get<bool>() || waits > 1000)) {
          world.send(connection, 0, {{"type", "redirect"}, {"address", coordinator_incarnation}});
          world.send(connection, 0, {});
        } else if (waits > 1200 || (one.hello.at("takeover").get<bool>() && known.empty())) {
          world.send(connection, 0, {});
        } else {
          continue;
        }
        accepted.erase(connection);
      }
  }
  void take_probed(const Json& message) {
    if (message.at("type") == "absorb")
      coordinator.hand_over(message.at("address"));
    else if (message.at("address") != name())
      ask_others(message.at("address"));
  }
  void ask_others(const std::string& address) {
    if (probe >= 0) world.send(std::exchange(probe, -1), 1, {});
    probe = world.connect(*this, address);
    if (probe >= 0) world.send(probe, 1, coordinator.probe(name()));
  }

  void receive(int connection, int side, const Json& message) {
    if (side == 1 && !message.is_null()) {
      take_first(connection, message);
    } else if (side == 1) {
      accepted.erase(connection);
      coordinator.lose(connection, world.time());
    } else if (connection == probe) {
      message.is_null() ? void(probe = -1) : take_probed(message);
    } else if (connection == link) {
      message.is_null() ? lost_coordinator() : take(message);
    }
    turn();
  }
  void turn() {
    if (world.front != this && world.now >= next_front) {
      next_front = world.now + 500;
      if (!world.front && (rank == 0 || world.now - started >= 1000)) world.front = this;
    }
    answer_waiting();
    if (world.now >= next_heartbeat) {
      next_heartbeat = world.now + static_cast<int>(kRankHeartbeat.count());
      coordinator.beat();
      if (link >= 0 && is_member) world.send(link, 1, {{"type", "alive"}});
    }
    if (coordinator.serving()) {
      coordinator.tick(world.time());
      if (world.front != this && world.now >= next_probe) {
        next_probe = world.now + 500;
        ask_others(kRendezvous);
      }
    }
    if (link >= 0 && is_member) world.check(world.now - heard <= kRankSilence.count(), "a living one is silent");
    if (link >= 0 && !is_member && world.now > hello_deadline) drop_link();
    if (link < 0) search();
  }
  void turn_again() {
    turn();
    later(50, [this] { turn_again(); });
  }

  World& world;
  const int rank, number;
  const int started = world.now;
  bool alive = true;
  int work = 0, updates = 0, history = 0;
  Json meeting, question;
  std::string awaited, called_by;
  std::uint64_t committed = 0, seen = 0;
  int link = -1, probe = -1;
  std::string coordinator_incarnation;
  bool is_member = false, kept = false, has_sum = false;
  std::deque<std::pair<std::string, bool>> candidates;  // with whether it takes over
  std::map<int, std::string> known;
  int heard = 0, hello_deadline = 0, next_search = 0, next_front = 0, next_heartbeat = 0, next_probe = 0;
  std::map<int, Accepted> accepted;
  Coordinator coordinator{std::to_string(number), [this](int connection, const Json* message) {
                            world.send(connection, 0, message ? *message : Json());
                          }};
};

void World::start(int rank) {
  const int number = static_cast<int>(processes.size());
  processes.push_back(std::make_unique<RankProcess>(*this, rank, number));
  processes.back()->turn_again();
}

int World::connect(RankProcess& client, const std::string& address) {
  RankProcess* const server = address == kRendezvous ? front : &process(std::stoi(address));
  if (!server || !server->alive) return -1;
  connections.push_back({{&client, server}});
  return static_cast<int>(connections.size()) - 1;
}

void World::send(int number, int side, const Json& message) {
  Connection& connection = connections[static_cast<std::size_t>(number)];
  if (!connection.open[1 - side]) return;
  if (message.is_null()) connection.open[1 - side] = false;
  if (waits_for_decision && !message.is_null() && message.at("type") == "decision") {
    waits_for_decision = false;
    after(pick(0, 30), [this] { kill(true); });
  }
  int& arrives = connection.arrives[side];
  arrives = std::max(arrives, now + pick(1, 30));
  after(arrives - now, [&connection, number, side, message] {
    if (!connection.open[side] || !connection.ends[side]->alive) return;
    if (!message.is_null() && connection.cut[side]) return;
    if (message.is_null()) connection.open[side] = false;
    connection.ends[side]->receive(number, side, message);
  });
}

int World::add(int before, const std::vector<int>& content) {
  const auto [found, is_new] = known_updates.try_emplace({before, content}, static_cast<int>(updates.size()));
  if (!is_new) return found->second;
  for (int earlier = before; earlier > 0; earlier = update(earlier).before)
    for (const int work : update(earlier).works)
      check(!std::count(content.begin(), content.end(), work), "work " + std::to_string(work) + " counts twice");
  updates.push_back({before, update(before).count + 1, content});
  return found->second;
}

void World::counted(RankProcess& process) {
  log += std::to_string(now) + " " + process.name() + " " + std::to_string(process.history) + "\n";
  // All that live say the same: of two histories, the shorter one is the beginning of the other.
  for (const auto& other : processes) {
    if (!other->alive) continue;
    int longer = process.history, shorter = other->history;
    if (update(longer).count < update(shorter).count) std::swap(longer, shorter);
    while (update(longer).count > update(shorter).count) longer = update(longer).before;
    check(longer == shorter, "processes " + process.name() + " and " + other->name() + " have other histories");
  }
  if (process.lacks_any()) return;  // decided before the kill
  if (to_continue.erase(process.number) > 0) slowest = std::max(slowest, now - killed_at);
  if (next_is_due || !to_continue.empty() || process.meeting.at("attendees").size() < kRanks) return;
  next_is_due = true;
  after(pick(0, 400), [this] { kill(); });
}

void World::kill(bool pair_ends) {
  next_is_due = false;
  if (kills == kRanks * kKillsOfEach) return events.clear();
  const int rank = kills++ % kRanks;
  killed_at = now;
  for (const auto& process : processes) {
    if (!process->alive) continue;
    if (process->rank == rank)
      victim = process->number;
    else
      to_continue.insert(process->number);
  }
  to_continue.erase(victim);
  RankProcess& killed = process(victim);
  killed.alive = false;
  if (front == &killed) front = nullptr;
  for (std::size_t i = 0; i < connections.size(); ++i)
    for (const int side : {0, 1}) {
      Connection& connection = connections[i];
      if (connection.ends[1 - side] != &killed || !connection.open[1 - side]) continue;
      connection.cut[side] = pick(0, 1) == 1;  // so that some members learn what others do not
      send(static_cast<int>(i), side, {});
    }
  after(pick(100, 1500), [this, rank] { start(rank); });
  // Sometimes the next one is killed before the others have gone on, also while it says that an update does not count:
  // only then is there something that one member knows and the votes of the others do not say.
  if (pair_ends || kills == kRanks * kKillsOfEach || pick(0, 1) == 0) return;
  next_is_due = true;
  waits_for_decision = pick(0, 1) == 0;
  if (!waits_for_decision) after(pick(0, 150), [this] { kill(true); });
}

void World::run() {
  for (int rank = 0; rank < kRanks; ++rank) after(pick(0, 300), [this, rank] { start(rank); });
  while (!events.empty() && fault.empty()) {
    const auto next = events.extract(events.begin());
    now = next.key().first;
    next.mapped()();
    check(to_continue.empty() || now - killed_at <= kContinuation, "the survivors do not go on");
    check(now - killed_at <= 20000, "the killed one does not come back");
  }
}

TEST(RankKillsTest, NoWorkIsLostOrCountsTwiceWhenRanksAreKilledAtAnyMoment) {
  int slowest = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    World world(seed);
    world.run();
    EXPECT_EQ(world.fault, "") << "seed " << seed;
    EXPECT_TRUE(!world.fault.empty() || world.kills == kRanks * kKillsOfEach) << "seed " << seed;
    slowest = std::max(slowest, world.slowest);
    if (seed > 2) continue;
    World again(seed);
    again.run();
    EXPECT_EQ(world.log, again.log) << "what happens depends on more than the seed";
  }
  RecordProperty("slowest_continuation_ms", slowest);
}

}  // namespace
}  // namespace citylearn::testing
