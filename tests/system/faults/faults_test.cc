// SPDX-License-Identifier: Apache-2.0
// A training run whose services are killed at random moments: it goes on, loses nothing and learns as well.
// In simulation each is killed five times, over a vendor once. The suites Long... kill more often: `./run test --long`.
#include <gtest/gtest.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/util/random.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/ledger.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

constexpr seconds kMaxRestart{10};

struct Plan {
  std::string middleware;
  int kills = 5;          ///< of each service
  bool pictures = false;  ///< and an encoder_service
};

/// Env_services, an encoder_service where there are pictures, a policy_service and a dashboard.
class Town {
 public:
  explicit Town(const Plan& plan) : plan_(plan), trial_(plan.middleware), witness_(plan.middleware, trial_.domain()) {
    if (plan_.pictures) start("encoder");
    for (const std::string id : {"dashboard", "one", "two", "policy"}) start(id);
  }

  Witness& witness() { return witness_; }
  std::vector<std::string> ids() const {
    std::vector<std::string> ids;
    for (const auto& [id, service] : services_) ids.push_back(id);
    return ids;
  }
  Service& operator[](const std::string& id) { return *services_.at(id); }
  std::string store() const { return trial_.folder() / "dashboard.sqlite"; }
  std::string out() const { return trial_.folder() / "out"; }

  void start(const std::string& id) {
    std::unique_ptr<Service>& service = services_[id];
    const bool again = service != nullptr;
    service.reset();  // another process of this id would stand in its way
    if (id == "policy") {
      // A wire that loses actions makes the run last: each is asked for again after 50 ms.
      std::vector<std::string> options = {
          "--middleware", "lossy,drop=0.1,seed=4:" + plan_.middleware, "--environments", "2", "--steps", "1000000000"};
      if (again) options.push_back("--resume");
      service = policy(options, "out");
    } else if (id == "dashboard") {
      service = trial_.start_recorder(store());
    } else if (id == "encoder") {
      service = trial_.encoder({"--encoder", "hog", "--reference", "summer"});
    } else {
      service = env("summer", id);
    }
  }
  std::unique_ptr<Service> env(const std::string& traversal, const std::string& id) {
    Arguments options = {"--agents", "8", "--id", id, "--recorders", "dashboard", "--linger", "60"};
    if (plan_.pictures) options.insert(options.end(), {"--dataset", "synthetic", "--frames", "0:96"});
    return trial_.env(traversal, options);
  }
  std::unique_ptr<Service> policy(Arguments options, const std::string& output) {
    options.insert(options.end(), {"--agent", "place_filter", "--learner", "relabel", "--checkpoint-every", "5",
                                   "--output", trial_.folder() / output, "--tasks", "200", "--evaluate", "summer"});
    // The recommended learning rate falls to zero within 40,000 steps; a run without an end keeps what it begins with,
    // and with that rate it forgets to look after 100,000 steps, killed or not.
    if (plan_.kills > 1) options.insert(options.end(), {"--relabel-learning-rate", "0.0003"});
    if (plan_.pictures) options.insert(options.end(), {"--frames", "0:96"});
    return trial_.policy(options);
  }
  Json summary(const std::string& output) const {
    return Json::parse(contents(trial_.folder() / (output + "/summary.json")));
  }

 private:
  Plan plan_;
  Trial trial_;
  Witness witness_;
  std::map<std::string, std::unique_ptr<Service>> services_;
};

void survive(const Plan& plan) {
  Town town(plan);
  Witness& witness = town.witness();
  ASSERT_TRUE(witness.until([&] { return witness.updates >= 10; }, kLongWait)) << town["policy"].output();
  std::vector<std::string> victims;
  for (const std::string& id : town.ids())
    if (id != "two") victims.insert(victims.end(), static_cast<std::size_t>(plan.kills), id);
  Random random{11};
  for (std::size_t i = victims.size(); i > 1; --i) std::swap(victims[i - 1], victims[random.below(i)]);
  std::map<std::string, double> slowest;
  for (const std::string& id : victims) {
    witness.listen(milliseconds(50 + random.below(450)));
    const std::uint64_t before = witness.incarnation(id);
    const Clock::time_point since = Clock::now();
    ASSERT_EQ(town[id].end(SIGKILL, kLongWait), 128 + SIGKILL) << id << " had ended before\n" << town[id].output();
    town.start(id);
    // It is there again, it does its work, and the run goes on with it.
    const auto works = [&] {
      if (witness.incarnation(id) == before) return false;
      return id == "one" ? witness.episodes(id) > 0 : true;
    };
    ASSERT_TRUE(witness.until(works, kMaxRestart)) << id << "\n" << town[id].output();
    const std::uint64_t updates = witness.updates;
    ASSERT_TRUE(witness.until([&] { return witness.updates > updates + 1; },
                              std::chrono::ceil<milliseconds>(since + kMaxRestart - Clock::now())))
        << id << "\n"
        << town["policy"].output();
    const double took = std::chrono::duration<double>(Clock::now() - since).count();
    slowest[id] = std::max(slowest[id], took);
  }

  // The rest of the run: an update more, and the evaluation. Nobody disturbs it.
  const std::uint64_t steps = witness.steps;
  ASSERT_EQ(town["policy"].end(SIGTERM, kLongWait), 130) << town["policy"].output();
  auto last = town.policy({"--resume", "--steps", "1000000000", "--time-limit", "0.001", "--environments", "2"}, "out");
  ASSERT_TRUE(witness.until([&] { return last->wait(milliseconds(1)).has_value(); }, kLongWait)) << last->output();
  for (const std::string id : {"one", "two"}) town[id].send(SIGTERM);
  Ledger counted;
  for (const std::string id : {"one", "two"}) {
    ASSERT_TRUE(witness.until([&] { return town[id].wait(milliseconds(1)).has_value(); }, kLongWait))
        << town[id].output();
    const std::string said = town[id].output(), words = "stops: ";
    const std::size_t at = said.find(words);
    ASSERT_TRUE(contains(said, " episodes, all acknowledged"));
    const auto count = std::stoull(said.substr(at + words.size()));
    for (std::uint64_t episode = 1; episode <= count; ++episode) counted[{id, witness.incarnation(id)}].insert(episode);
  }
  ASSERT_EQ(town["dashboard"].end(SIGTERM, kLongWait), 0) << town["dashboard"].output();

  const Ledger recorded = in_store(town.store()), learned = in_csv(town.out() + "/episodes.csv");
  for (const auto& [source, episodes] : counted)
    for (const Ledger* ledger : {&recorded, &learned}) {
      const auto found = ledger->find(source);
      EXPECT_TRUE(found != ledger->end() && found->second == episodes)
          << source.id << " " << source.incarnation << ": " << episodes.size() << " episodes, "
          << (ledger == &recorded ? "recorded: " : "learned from: ")
          << (found == ledger->end() ? 0 : found->second.size()) << " of it, " << entries(*ledger) << " of all\n"
          << town["policy"].output() << last->output() << town[source.id].output();
    }
  expect_all_acknowledged(recorded, witness.acknowledged["dashboard"]);
  expect_all_acknowledged(learned, witness.acknowledged["policy"]);

  // As good as a run of as many steps that nobody disturbed.
  auto one = town.env("summer", "one"), two = town.env("summer", "two");
  if (plan.pictures) town.start("encoder");
  town.start("dashboard");
  auto calm = town.policy({"--steps", std::to_string(steps), "--environments", "2"}, "calm");
  ASSERT_EQ(calm->wait(kLongWait), 0) << calm->output();
  for (const std::string output : {"out", "calm"}) {
    const Json score = town.summary(output)["evaluate"]["summer"];
    EXPECT_EQ(score["completed"], 1.0) << output;
    EXPECT_GE(score["spl"], 0.9) << output;
    std::printf("%s: %llu steps, SPL %.3f\n", output.c_str(), static_cast<unsigned long long>(steps),
                score["spl"].get<double>());
  }
  for (const auto& [id, took] : slowest) std::printf("%s: goes on within %.1f s\n", id.c_str(), took);
  std::printf("%zu episodes counted at the end, %zu recorded, %zu learned from\n", entries(counted), entries(recorded),
              entries(learned));
}

#ifdef CITYLEARN_SIMULATED

TEST(Kills, TrainingGoesOnAndNothingIsLost) { survive({"simulated", 5, false}); }
TEST(Kills, TrainingOnPicturesGoesOnAndNothingIsLost) { survive({"simulated", 5, true}); }

#else

class Kills : public VendorTest {};
CITYLEARN_EACH_VENDOR(Kills);

TEST_P(Kills, TrainingGoesOnAndNothingIsLost) { survive({GetParam(), 1, false}); }

class LongKills : public VendorTest {};
CITYLEARN_EACH_VENDOR(LongKills);

TEST_P(LongKills, TrainingGoesOnAndNothingIsLost) { survive({GetParam(), 20, false}); }
TEST_P(LongKills, TrainingOnPicturesGoesOnAndNothingIsLost) { survive({GetParam(), 20, true}); }

#endif

}  // namespace
}  // namespace citylearn::testing
