// SPDX-License-Identifier: Apache-2.0
// Random histories: two policy_services, three env_services and a recorder are started, killed, frozen and resumed, and
// output folders are copied, in an order that a seed gives. No acknowledged episode is lost or doubled, and nobody
// waits in silence. CITYLEARN_HISTORIES=1000 runs as many, CITYLEARN_HISTORY_SEED=N begins with this one.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstdlib>

#include "core/util/random.h"
#include "dashboard/store/database.h"
#include "tests/simulation/services/history_model.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/ledger.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

std::uint64_t number_from(const char* variable, std::uint64_t otherwise) {
  const char* value = std::getenv(variable);
  return value ? std::stoull(value) : otherwise;
}

class History {
 public:
  explicit History(std::uint64_t seed)
      : random_{seed, 18}, trial_("simulated", 0), chronicle_(trial_.middleware().name, trial_.domain()) {}

  /// Returns what happened that must not.
  std::vector<std::string> run() {
    start_env("env-summer", false);
    if (random_.below(5) > 0) start_recorder();
    const int actions = 8 + static_cast<int>(random_.below(8));
    for (int i = 0; i < actions && faults_.empty(); ++i) {
      act();
      const Clock::time_point next = Clock::now() + milliseconds(20 + random_.below(700));
      until([&] { return Clock::now() >= next; }, seconds(2));
    }
    finish();
    check_files();
    if (fs::exists(store())) check_store();
    std::size_t heard = 0, required = 0;
    for (const auto& [source, numbers] : chronicle_.episodes) heard += numbers.size();
    for (const auto& [folder, ledger] : chronicle_.required) required += entries(ledger);
    std::printf("%zu processes, %zu episodes, %zu acknowledged by policy_services, %zu by the dashboard\n",
                chronicle_.programs.size(), heard, required, entries(chronicle_.acknowledged_by("dashboard")));
    return faults_;
  }
  /// Returns what was done, and what the services said.
  std::string story() const {
    std::string story = log_;
    for (const auto& program : chronicle_.programs) {
      const std::string said = program->service->output();
      story += "-- " + program->id + " " + program->folder + " (" + std::to_string(program->process) +
               ", incarnation " + std::to_string(program->incarnation) + ")\n" +
               said.substr(said.size() - std::min<std::size_t>(said.size(), 2500));
    }
    return story;
  }

 private:
  std::string store() const { return trial_.folder() / "dashboard.sqlite"; }
  void note(const std::string& what) {
    char time[32];
    std::snprintf(time, sizeof time, "%6.2f s  ", std::chrono::duration<double>(Clock::now() - begin_).count());
    log_ += time + what + "\n";
  }
  void fault(const std::string& what) {
    note("WRONG: " + what);
    faults_.push_back(what);
  }
  /// Also notes which programs have ended and which are silent.
  bool until(const std::function<bool()>& condition, milliseconds patience) {
    const auto done = [&] {
      look();
      return !faults_.empty() || condition();
    };
    return chronicle_.until(done, patience) && faults_.empty();
  }
  void look() {
    if (!faults_.empty()) return;
    for (const auto& program : chronicle_.programs)
      if (program->status && ended_.insert(program.get()).second) on_end(*program);
    if (const std::string who = chronicle_.silent(); !who.empty()) fault(who);
  }
  void on_end(const Program& program) {
    const int status = *program.status;
    note(program.id + " ended with " + std::to_string(status));
    const bool expected =
        status == 0 || (program.killed && status == 128 + SIGKILL) || (program.warned && status == 130);
    if (expected) return;
    const std::string said = program.service->output(), words = "\n" + program.kind + ": ";
    const std::size_t at = ("\n" + said).find(words);
    if (status != 1 || occurrences("\n" + said, words) != 1 || contains(said, "unexpected failure"))
      fault(program.id + " ended with " + std::to_string(status) + " and without one clear line");
    else
      std::printf("%s\n", said.substr(at, said.find('\n', at) - at).c_str());
  }

  /// The newest process of an id that was not told to end; null: none lives.
  Program* running(const std::string& id) const {
    Program* found = nullptr;
    for (const auto& program : chronicle_.programs)
      if (program->id == id && program->alive() && !program->warned) found = program.get();
    return found;
  }
  Program* owner(const std::string& folder) const {
    for (const auto& program : chronicle_.programs)
      if (!folder.empty() && program->folder == folder && program->alive()) return program.get();
    return nullptr;
  }
  Program& add(const std::string& kind, const std::string& id, std::unique_ptr<Service> service) {
    chronicle_.programs.push_back(std::make_unique<Program>());
    Program& program = *chronicle_.programs.back();
    program.id = id;
    program.kind = kind;
    program.process = service->process();
    program.service = std::move(service);
    program.news = Clock::now();
    return program;
  }
  void start_env(const std::string& id, bool known_recorders) {
    Arguments options = {"--id", id, "--linger", "2"};
    if (known_recorders) options.insert(options.end(), {"--recorders", "dashboard,a"});
    note("start " + id + (known_recorders ? " --recorders dashboard,a" : ""));
    add("env_service", id, trial_.env(id == "env-fall" ? "fall" : "summer", options));
  }
  void start_recorder() {
    note("start dashboard");
    add("recorder_process", "dashboard", trial_.start_recorder(store()));
  }

  void act() {
    // The same draws whatever the state, so that timing changes the history as little as it can.
    const std::uint64_t what = random_.below(100), how = random_.below(100), which = random_.below(1000);
    const Arguments policy = policy_arguments(which);
    const std::string id = what < 52   ? (which % 2 == 0 ? "a" : "b")
                           : what < 76 ? (which % 3 == 0   ? "env-summer"
                                          : which % 3 == 1 ? "env-two"
                                                           : "env-fall")
                                       : "dashboard";
    if (what >= 88) return copy(which);
    Program* const program = running(id);
    if (!program) {
      if (id == "dashboard") return start_recorder();
      return what < 52 ? start_policy(id, policy) : start_env(id, how < 30);
    }
    if (what < 52 && how < 15) return start_policy(id, policy);  // a second process of this id
    if (how < 45) {
      end(*program, SIGKILL);
    } else if (how < 70) {
      end(*program, SIGTERM);
    } else if (how < 85 && !program->frozen()) {
      const milliseconds time(how < 80 ? 100 + 10 * how : 4500);
      note("freeze " + id + " for " + std::to_string(time.count()) + " ms");
      program->service->send(SIGSTOP);
      program->thaw = Clock::now() + time;
    }
  }
  /// The first is the folder's name.
  Arguments policy_arguments(std::uint64_t which) {
    const std::uint64_t folder = random_.below(10), flags = random_.below(10);
    std::vector<std::string> folders = copies_;
    folders.insert(folders.end(), {"o1", "o2"});
    Arguments all = {folder < 2 ? folders[which % folders.size()] : folder < 8 ? (which % 2 == 0 ? "o1" : "o2") : ""};
    const bool train = random_.below(10) < 7;
    if (all[0].empty()) all[0] = copies_.empty() ? "o1" : copies_.back();
    if (train)
      all.insert(all.end(),
                 {"--agent", "place_filter", "--steps", std::to_string(512 * updates_), "--checkpoint-every", "5"});
    else
      all.insert(all.end(), {"--mode", "evaluate", "--agent", "blind"});
    if (flags < 6) all.push_back("--resume");
    if (flags == 6) all.push_back("--overwrite");
    const std::uint64_t on = random_.below(4);
    if (on > 0) all.insert(all.end(), {"--evaluate", on < 3 ? "summer" : "summer,fall"});
    if (random_.below(5) == 0) all.insert(all.end(), {"--wait", "4"});
    if (random_.below(8) == 0) all.insert(all.end(), {"--environments", "2"});
    const std::string loss = "lossy,drop=0.05,seed=" + std::to_string(which) + ":";
    if (updates_ > 100 || random_.below(2) == 0)
      all.insert(all.end(), {"--middleware", loss + trial_.middleware().name});
    return all;
  }
  void start_policy(const std::string& id, Arguments options) {
    const std::string name = options[0], folder = trial_.folder() / name;
    // Until it is certain whose folder it is.
    until([&] { return !owner(folder) || (owner(folder)->settled && !owner(folder)->warned); }, 2 * Chronicle::kSilent);
    options.erase(options.begin());
    const auto has = [&](const char* option) {
      return std::find(options.begin(), options.end(), option) != options.end();
    };
    const auto before = files_of(folder);
    Program* const other = owner(folder);
    const bool wrong =
        other || (!has("--resume") && !has("--overwrite") &&
                  (fs::exists(folder + "/manifest.json") || !csv_rows(folder + "/episodes.csv").empty()));
    chronicle_.require_acknowledged();
    std::string line = "start " + id + " in " + name;
    for (const std::string& option : options) line += " " + option;
    note(line + (wrong ? ", which is refused" : ""));
    options.insert(options.end(), {"--id", id, "--output", folder, "--frames", "0:16", "--tasks", "16"});
    Program& program = add("policy_service", id, trial_.policy(options));
    program.folder = folder;
    if (wrong) {
      until([&] { return !program.alive() || (other && !other->alive()); }, seconds(10));
      if (!program.alive() && *program.status != 0) {
        if (!other && files_of(folder) != before) fault("a refused start changed files");
        return;
      }
      if (other && other->frozen()) {  // perhaps when its run had ended and the folder was free
        thaw(*other);
        until([&] { return !other->alive(); }, seconds(1));
      }
      if (!other || other->alive()) fault("a wrong start was not refused");  // else that one ended in time
    }
    if (has("--overwrite")) {
      ++chronicle_.overwritten[folder];
      chronicle_.required[folder].clear();
    }
    program.overwritten = chronicle_.overwritten[folder];
  }
  void thaw(Program& program) {
    program.service->send(SIGCONT);
    program.thaw = {};
    program.news = Clock::now();
  }
  void end(Program& program, int signal) {
    note((signal == SIGKILL ? "kill " : "end ") + program.id);
    if (program.frozen()) thaw(program);
    (signal == SIGKILL ? program.killed : program.warned) = true;
    program.service->send(signal);
  }
  void copy(std::uint64_t which) {
    std::vector<std::string> from;
    for (const auto& entry : fs::directory_iterator(trial_.folder().path()))
      if (entry.is_directory()) from.push_back(entry.path().filename());
    if (from.empty() || copies_.size() >= 3) return;
    std::sort(from.begin(), from.end());
    const std::string source = from[which % from.size()], copy = "c" + std::to_string(copies_.size() + 1);
    note("copy " + source + " to " + copy);
    chronicle_.require_acknowledged();
    chronicle_.required[trial_.folder() / copy] = chronicle_.required[trial_.folder() / source];
    fs::copy(trial_.folder() / source, trial_.folder() / copy, fs::copy_options::recursive);
    copies_.push_back(copy);
  }

  /// Lets everybody show that it is not stuck, then ends all.
  void finish() {
    const Clock::time_point since = Clock::now();
    note("wait for news of all");
    const auto& programs = chronicle_.programs;
    until(
        [&] {
          return std::all_of(programs.begin(), programs.end(),
                             [&](const auto& p) { return !p->alive() || p->news > since; });
        },
        3 * Chronicle::kSilent);
    for (const char* kind : {"policy_service", "env_service", "recorder_process"}) {
      for (const auto& program : programs)
        if (program->kind == kind && program->alive() && !program->warned) end(*program, SIGTERM);
      const auto ended = [&] {
        return std::all_of(programs.begin(), programs.end(),
                           [&](const auto& p) { return p->kind != kind || !p->alive(); });
      };
      until(ended, 2 * Chronicle::kSilent);
      for (const auto& program : programs)
        if (program->kind == kind && program->alive() && faults_.empty()) fault(program->id + " does not end");
    }
  }

  void check_files() {
    chronicle_.require_acknowledged();
    std::map<std::uint64_t, std::string> runs;  // whose a run_id is
    for (const auto& program : chronicle_.programs) {
      if (program->run_id == 0) continue;
      const std::string whose = program->id + " in " + program->folder;
      const std::string& known = runs.try_emplace(program->run_id, whose).first->second;
      if (known != whose) fault("run " + std::to_string(program->run_id) + " is " + known + " and " + whose);
    }
    for (const auto& [folder, sources] : chronicle_.required) {
      const Ledger has = in_csv(folder + "/episodes.csv");
      expect_in(has, sources, folder);
      for (const auto& program : chronicle_.programs)
        if (program->folder == folder && program->overwritten == chronicle_.overwritten[folder])
          expect_no_hole(*program, has);
    }
  }
  void expect_in(const Ledger& has, const Ledger& required, const std::string& where) {
    for (const auto& [source, numbers] : required) {
      std::string missing;
      const auto found = has.find(source);
      for (const std::uint64_t number : numbers)
        if (found == has.end() || !found->second.contains(number)) missing += " " + std::to_string(number);
      if (!missing.empty())
        fault("lost in " + where + ": of " + source.id + " " + std::to_string(source.incarnation) +
              missing.substr(0, 200));
    }
  }
  /// Expects no gap in the episodes that a process commanded.
  void expect_no_hole(const Program& program, const Ledger& has) {
    for (const auto& [source, numbers] : has) {
      std::uint64_t missing = 0;
      for (const auto& [number, heard] : chronicle_.episodes[source]) {
        if (heard.policy != program.incarnation || program.incarnation == 0) continue;
        if (!numbers.contains(number)) {
          if (missing == 0) missing = number;
        } else if (missing > 0) {
          fault("a hole in " + program.folder + ": of " + source.id + " " + std::to_string(missing) +
                " is not there, " + std::to_string(number) + " is");
          break;
        }
      }
    }
  }
  void check_store() {
    const Ledger acknowledged = chronicle_.acknowledged_by("dashboard");
    if (acknowledged.empty()) return;  // it may have been killed before it made its tables
    expect_in(in_store(store()), acknowledged, store());
    SQLite::Database database = open_database(store());
    SQLite::Statement rows(database,
                           "SELECT environment, s.incarnation, episode, e.run_id, r.policy FROM episodes e "
                           "JOIN sources s ON s.id = e.source JOIN runs r ON r.id = e.run");
    while (rows.executeStep() && faults_.size() < 5) {
      const Source source{value_at<std::string>(rows, 0), std::stoull(value_at<std::string>(rows, 1))};
      const auto& heard = chronicle_.episodes[source];
      const auto episode = heard.find(std::stoull(value_at<std::string>(rows, 2)));
      if (episode == heard.end()) continue;
      const Program* program = chronicle_.find(episode->second.policy);
      const std::string where = "episode " + std::to_string(episode->first) + " of " + source.id;
      if (std::stoull(value_at<std::string>(rows, 3)) != episode->second.run_id) fault(where + " has another run_id");
      if (program && !rows.isColumnNull(4) && value_at<std::string>(rows, 4) != program->id)
        fault(where + " stands under a run of " + value_at<std::string>(rows, 4));
    }
  }

  Random random_;
  Trial trial_;
  Chronicle chronicle_;
  const std::uint64_t updates_ =
      std::array{4, 30, 5000}[random_.below(3)];  // of all trainings, so that each fits each folder
  const Clock::time_point begin_ = Clock::now();
  std::vector<std::string> copies_, faults_;
  std::set<const Program*> ended_;
  std::string log_;
};

class Histories : public ::testing::TestWithParam<std::uint64_t> {};
const std::uint64_t kFirstSeed = number_from("CITYLEARN_HISTORY_SEED", 1);
const std::uint64_t kCount = number_from("CITYLEARN_HISTORIES", std::getenv("CITYLEARN_HISTORY_SEED") ? 1 : 8);
INSTANTIATE_TEST_SUITE_P(, Histories, ::testing::Range(kFirstSeed, kFirstSeed + kCount),
                         [](const auto& seed) { return "Seed" + std::to_string(seed.param); });

TEST_P(Histories, NothingIsLostOrDoubledAndNobodyIsSilent) {
  History history(GetParam());
  const std::vector<std::string> faults = history.run();
  std::string all;
  for (const std::string& fault : faults) all += fault + "\n";
  EXPECT_TRUE(faults.empty()) << all;
  if (HasFailure())
    ADD_FAILURE() << "CITYLEARN_HISTORY_SEED=" << GetParam() << " repeats this history:\n" << history.story();
}

}  // namespace
}  // namespace citylearn::testing
