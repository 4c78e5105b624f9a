// SPDX-License-Identifier: Apache-2.0
// ./run demo starts and stops its services, and says what went wrong.
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <regex>
#include <set>

#include "tests/paths.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/hosts.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

/// A demo in a process group of its own, as a terminal starts it; whatever is left of it ends with the test.
class Demo {
 public:
  explicit Demo(const Arguments& arguments, std::uint32_t domain = own_domain(),
                const Arguments& frames = {"--frames", "0:80"}, const Arguments& environment = {})
      : output_(folder_ / "demo/out put") {
    // A shell in the background ignores SIGINT, and its children inherit that.
    Arguments command = {"/usr/bin/env", "--default-signal=INT", "CITYLEARN_BUILD=" CITYLEARN_BINARY_DIR};
    command.insert(command.end(), environment.begin(), environment.end());
    command.insert(command.end(),
                   {"CITYLEARN_RUNS=" + (folder_ / "all runs"), "CITYLEARN_DOMAIN=" + std::to_string(domain),
                    "/usr/bin/setsid", CITYLEARN_SOURCE_DIR "/run", "demo", "--output", output_});
    command.insert(command.end(), frames.begin(), frames.end());
    command.insert(command.end(), arguments.begin(), arguments.end());
    shell_.emplace(command, folder_ / "log");
    group_ = shell_->process();
  }
  ~Demo() { ::kill(-group_, SIGKILL); }
  Service* operator->() { return &*shell_; }
  /// A signal to all processes of the demo, as Ctrl-C sends it.
  void interrupt() const { ::kill(-group_, SIGINT); }
  const std::string& output() const { return output_; }
  /// Returns what `./run` prints for a command, in this demo's folder.
  std::string run(const std::string& command, const std::string& environment = "") const {
    return shell(environment + " CITYLEARN_BUILD=" CITYLEARN_BINARY_DIR " CITYLEARN_RUNS='" + (folder_ / "all runs") +
                 "' " + CITYLEARN_SOURCE_DIR "/run " + command + " 2>&1 || true");
  }

 private:
  Folder folder_;
  std::string output_;
  std::optional<Service> shell_;
  pid_t group_ = 0;  // of the demo, also once its shell has ended
};

/// Waits until the agent learns, and checks that every service of a run with images is there.
void expect_training(Demo& demo, Witness& witness) {
  ASSERT_TRUE(witness.until([&] { return witness.updates >= 3; }, kLongWait)) << demo->output();
  for (const char* id : {"env-summer", "encoder", "policy", "dashboard"})
    ASSERT_TRUE(witness.until([&] { return witness.status.contains(id); }, kLongWait)) << id << demo->output();
}

void expect_none_left(const Witness& witness) {
  for (const auto& [id, status] : witness.status)
    EXPECT_NE(::kill(static_cast<pid_t>(status.process()), 0), 0) << id << " still runs";
}

const Arguments kEndless = {"--slip", "0", "--evaluate", "summer", "--steps", "1000000000"};

TEST(Demo, PrintsItsTable) {
  Demo demo({"--evaluate", "summer,fall", "--steps", "2048", "--tasks", "4", "--overwrite", "--no-dashboard"});
  ASSERT_EQ(demo->wait(kLongWait), 0) << demo->output();
  // SPL of the agent, shuffled, and the controls by name, of which shortest_path is the last.
  for (const char* row :
       {"traversal +filter +shuffled +blind", "fall( +[0-9]\\.[0-9]{3}){5} +1\\.000", "summer +[0-9]\\."})
    EXPECT_TRUE(std::regex_search(demo->output(), std::regex(row))) << row << demo->output();
  EXPECT_TRUE(contains(demo->output(), "\n  " CITYLEARN_SOURCE_DIR "/run demo --data DIR")) << demo->output();
  for (const char* said : {"run: actions slip", "All of it is imperfect: slip0.1", "Learning gained "})
    EXPECT_EQ(occurrences(demo->output(), said), 1) << said << demo->output();
  EXPECT_TRUE(fs::exists(demo.output() + "/summary.json")) << "a folder with a blank";
}

TEST(Demo, TakesRecordingsWhoseNamesHaveBlanks) {
  Folder data;
  const std::string long_name(64, 'x');
  for (const std::string& name :
       {std::string("my drive"), std::string("the other  drive"), long_name, std::string("caf\xE9")}) {
    std::string table;
    for (int frame = 0; frame < 80; ++frame)
      table += std::to_string(std::cos(frame)) + "," + std::to_string(std::sin(frame)) + "\n";
    make_file(data / (name + ".csv"), table);
  }
  Demo demo({"--data", data.path(), "--steps", "1024", "--tasks", "4", "--agent", "features", "--no-dashboard"},
            own_domain(), {"--frames", "0:80"}, {"LC_ALL=C.UTF-8"});  // in which one name is not a text
  ASSERT_EQ(demo->wait(kLongWait), 0) << demo->output();
  for (const char* row : {"caf_ +[0-9.]+ ", "my_drive +[0-9.]+ ", "the_other__drive +[0-9.]+ ", "\nx{56} +[0-9.]+ "})
    EXPECT_TRUE(std::regex_search(demo->output(), std::regex(row))) << row << demo->output();
  EXPECT_FALSE(fs::exists(demo.output() + "/logs/encoder.log")) << "they are features already";
}

// b is driven twice as fast as a: its frame i shows the place of frame 2i. By index it has no more than 100 places.
TEST(Demo, SaysWhatItChoseAndTakesWhatIsAsked) {
  Folder data;
  for (const auto& [name, frames] : {std::pair{"a", 200}, {"b", 100}}) {
    std::string table, poses = "metres\n";
    for (int place = 0; place < 200; place += 200 / frames) {
      table += std::to_string(std::cos(place)) + "," + std::to_string(std::sin(place)) + "\n";
      poses += std::to_string(place) + "\n";
    }
    make_file(data / (std::string(name) + ".csv"), table);
    make_file(data / (std::string(name) + ".poses.csv"), poses);
  }
  Demo demo({"--data", data.path(), "--align-by", "distance", "--align-within=2", "--steps", "1024", "--tasks", "4",
             "--agent", "features", "--controls", "blind", "--no-dashboard"},
            own_domain(), {});
  ASSERT_EQ(demo->wait(kLongWait), 0) << demo->output();
  for (const char* said : {"trains on 'a', as no traversal is called summer", "first 128 of the 200 frames of 'a'",
                           "in a, where it trained", "\nb "})
    EXPECT_TRUE(contains(demo->output(), said)) << said << demo->output();
  EXPECT_FALSE(contains(demo->output(), "sequence")) << demo->output();
}

// A drive whose only camera is not the default one, and shorter than the defaults.
TEST(Demo, TakesParametersOfDatasetsAndEncodersAndAShortRoute) {
  Folder data;
  const std::string camera = data / "2011_09_26_drive_0001_sync/image_00";
  std::string times;
  for (int i = 10; i < 22; ++i) {
    std::string picture = "P6 8 8 255\n";  // a reader looks at the bytes, not at the name
    for (int k = 0; k < 8 * 8 * 3; ++k) picture += static_cast<char>(k * i % 251);
    make_file(camera + "/data/00000000" + std::to_string(i + 90).substr(1) + ".png", picture);
    times += "2011-09-26 13:02:" + std::to_string(i) + ".5\n";
  }
  make_file(camera + "/timestamps.txt", times);
  Demo demo({"--data", data.path(), "--dataset", "kitti", "--kitti-camera", "0", "--encoder", "hog",
             "--hog-cells-across=4", "--steps", "512", "--tasks", "4", "--no-dashboard"},
            own_domain(), {});
  ASSERT_EQ(demo->wait(kLongWait), 0) << demo->output();
  EXPECT_TRUE(contains(demo->output(), "--frames is 0:12 instead of 0:128")) << demo->output();
  EXPECT_TRUE(contains(contents(demo.output() + "/logs/encoder.log"), "--dimension is 11 instead of 64"));
  EXPECT_TRUE(contains(demo->output(), "2011_09_26_drive_0001_sync")) << demo->output();
}

TEST(Demo, CtrlCAndSigtermStopAllWithinTwoSeconds) {
  for (const int signal : {SIGINT, SIGTERM}) {
    SCOPED_TRACE(signal);
    const std::uint32_t domain = own_domain();
    Witness witness("cyclonedds", domain);
    Demo demo(kEndless, domain);
    expect_training(demo, witness);
    signal == SIGINT ? demo.interrupt() : demo->send(SIGTERM);
    EXPECT_EQ(demo->wait(seconds(2)), 128 + signal) << demo->output();
    expect_none_left(witness);
  }
}

TEST(Demo, IsFoundByToolsWhileItRuns) {
  const std::uint32_t domain = own_domain();
  Witness witness("cyclonedds", domain);
  Demo demo(kEndless, domain);
  expect_training(demo, witness);
  EXPECT_TRUE(contains(demo->output(), "run: domain " + std::to_string(domain) + ", session ")) << demo->output();
  const std::string seen = demo.run("doctor --seconds 3");
  EXPECT_TRUE(contains(seen, "run: looks at the demo that runs here: --domain " + std::to_string(domain))) << seen;
  EXPECT_TRUE(contains(seen, "training on summer")) << seen;
  demo->send(SIGTERM);
  EXPECT_EQ(demo->wait(seconds(2)), 143) << demo->output();
  EXPECT_FALSE(contains(demo.run("doctor --seconds 1"), "looks at the demo"));
}

TEST(Demo, NamesAServiceThatEndsEarlyAndItsLog) {
  const std::uint32_t domain = own_domain();
  Witness witness("cyclonedds", domain);
  Demo demo(kEndless, domain);
  expect_training(demo, witness);
  const auto kill = [&](const std::string& id) {
    ASSERT_EQ(::kill(static_cast<pid_t>(witness.status[id].process()), SIGKILL), 0) << id;
  };
  kill("dashboard");  // the run does not need it
  EXPECT_TRUE(demo->says("the dashboard ended early", seconds(30))) << demo->output();
  EXPECT_TRUE(contains(demo->output(), demo.output() + "/logs/dashboard.log"));
  const std::uint64_t updates = witness.updates;
  EXPECT_TRUE(witness.until([&] { return witness.updates > updates; }, seconds(30))) << demo->output();
  kill("env-summer");
  EXPECT_EQ(demo->wait(seconds(30)), 1) << demo->output();
  EXPECT_TRUE(contains(demo->output(), "run: env-summer ended early (status 137); its log is " + demo.output() +
                                           "/logs/env-summer.log\n"));
  expect_none_left(witness);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which hold memory of their own
TEST(Demo, AServiceAtItsMemoryLimitComesBackAndNothingIsLost) {
  const Arguments options = {"--slip",  "0", "--evaluate", "summer,fall",        "--steps", "400000",
                             "--tasks", "8", "--lockstep", "--checkpoint-every", "20",      "--no-wait"};
  const auto last_checkpoint = [](const Demo& demo) {
    std::set<std::string> names;
    std::error_code none_yet;
    for (const auto& entry : fs::directory_iterator(demo.output() + "/checkpoints", none_yet))
      names.insert(entry.path());
    names.erase(demo.output() + "/checkpoints/best.clk");
    return names.empty() ? "" : contents(*names.rbegin());
  };
  const std::uint32_t domain = own_domain();
  Witness witness("cyclonedds", domain);
  Demo disturbed(options, domain, {"--frames", "0:80"}, {"LD_PRELOAD=" MEMORY_LEAK, "CITYLEARN_MEMORY_LIMIT=300M"});
  const auto signal = [&](const std::string& id, int number) {
    ASSERT_TRUE(witness.until([&] { return witness.status.contains(id); }, kLongWait)) << id << disturbed->output();
    ASSERT_EQ(::kill(static_cast<pid_t>(witness.status[id].process()), number), 0) << id << disturbed->output();
  };
  ASSERT_TRUE(witness.until([&] { return witness.status.contains("env-summer"); }, kLongWait)) << disturbed->output();
  ASSERT_TRUE(witness.until([&] { return !last_checkpoint(disturbed).empty(); }, kLongWait)) << disturbed->output();
  signal("env-summer", SIGSTOP);  // so that training is not over before the others are back, however fast it is
  // A restarted env_service begins new episodes, so it is the one for evaluation.
  std::map<std::string, std::uint64_t> before;
  for (const std::string id : {"policy", "env-fall", "encoder", "dashboard"}) {
    signal(id, SIGUSR2);
    before[id] = witness.incarnation(id);
  }
  for (const auto& [id, incarnation] : before)
    EXPECT_TRUE(witness.until([&] { return witness.incarnation(id) != incarnation; }, kLongWait)) << id;
  signal("env-summer", SIGCONT);
  ASSERT_EQ(disturbed->wait(kLongWait), 0) << disturbed->output();
  const std::regex limited("starts again, as it holds [0-9]+ MB of memory, more than its limit of 300 MB");
  EXPECT_TRUE(std::regex_search(disturbed->output(), limited)) << disturbed->output();
  EXPECT_TRUE(contains(disturbed->output(), "resuming after update")) << disturbed->output();
  for (const std::string name : {"env-fall", "encoder", "dashboard"})
    EXPECT_TRUE(std::regex_search(contents(disturbed.output() + "/logs/" + name + ".log"), limited)) << name;
  Demo calm(options);
  ASSERT_EQ(calm->wait(kLongWait), 0) << calm->output();
  EXPECT_TRUE(last_checkpoint(disturbed) == last_checkpoint(calm));
}
#endif

TEST(Demo, WrongOptionsEndItAtOnce) {
  for (const auto& [wrong, complaint] : {std::pair<Arguments, std::string>{{"--frames", "9:3"}, "is not FIRST:END"},
                                         {{"--data", "/no where"}, "'/no where' is not a folder"},
                                         {{"--agent", "no such"}, "no such"},
                                         {{"--kitti-camera", "0"}, "is for dataset kitti"}}) {
    Demo demo(wrong);
    const auto status = demo->wait(seconds(10));
    EXPECT_TRUE(status == 1 || status == 2) << wrong[0] << status.value_or(-1) << demo->output();
    EXPECT_TRUE(contains(demo->output(), complaint));
  }
}

}  // namespace
}  // namespace citylearn::testing
