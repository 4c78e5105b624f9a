// SPDX-License-Identifier: Apache-2.0
#include "core/wire/service.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "core/command_line/settings_file.h"
#include "core/files/files.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Returns what a service with these options writes to standard error when it logs `text`.
std::string logged(const std::string& name, std::vector<std::string> options, const std::string& text,
                   bool journal = false) {
  options.insert(options.begin(), name);
  std::vector<char*> arguments;
  for (std::string& option : options) arguments.push_back(option.data());
  Node::Options node;
  node.service = "env_service";
  const auto before = spdlog::default_logger();
  ::testing::internal::CaptureStderr();
  struct stat error {};
  ::fstat(STDERR_FILENO, &error);
  if (journal)
    ::setenv("JOURNAL_STREAM", (std::to_string(error.st_dev) + ":" + std::to_string(error.st_ino)).c_str(), 1);
  service_main(
      static_cast<int>(arguments.size()), arguments.data(), "A service.",
      [&](CLI::App& app) { add_node_options(app, node); },
      [&] {
        spdlog::warn("{}", text);
        spdlog::default_logger()->flush();
        return 0;
      });
  spdlog::set_default_logger(before);
  spdlog::drop(name);  // spdlog 1.15 keeps the name of a former default logger
  spdlog::set_level(spdlog::level::info);
  ::unsetenv("JOURNAL_STREAM");
  return ::testing::internal::GetCapturedStderr();
}

/// Every byte but what UTF-8 needs, a forged line, a sequence that clears a terminal, and the same of 8 bits.
std::string nasty() {
  std::string text =
      "'a\n00:00:00.000 I [env_service] all is well\x1B[2J\xC2\x9B"
      "2J \"\\%v%n{}";
  for (char c = 0; c < 127; ++c) text += c;
  return text + "\x7F grüßt'";
}

TEST(ServiceLog, NoTextForgesALineOrCommandsATerminal) {
  const std::string lines = logged("logs_text", {}, nasty());
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1);
  EXPECT_EQ(lines.back(), '\n');
  EXPECT_TRUE(
      contains(lines, " W [logs_text] 'a\\x0a00:00:00.000 I [env_service] all is well\\x1b[2J\\x9b2J \"\\%v%n{}"));
  EXPECT_TRUE(contains(lines, "\\x7f grüßt'\n"));
  EXPECT_FALSE(contains(lines, "\xC2\x9B"));
  for (const char c : lines.substr(0, lines.size() - 1)) EXPECT_TRUE(c < 0 || (c >= ' ' && c != 0x7F)) << int{c};
}

TEST(ServiceLog, JsonIsJsonWhateverItSays) {
  const std::string lines =
      logged("logs_json", {"--session", "demo-1", "--id", "env-1", "--log-format", "json"}, nasty() + "\xFF");
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1);
  for (const char c : lines.substr(0, lines.size() - 1)) EXPECT_TRUE(c >= ' ' && c != 0x7F) << int{c};
  const nlohmann::json line = nlohmann::json::parse(lines, nullptr, false);
  ASSERT_TRUE(line.is_object()) << lines;
  EXPECT_EQ(line["message"], nasty() + "\xEF\xBF\xBD");
  EXPECT_EQ(line["level"], "warning");
  EXPECT_EQ(line["session"], "demo-1");
  EXPECT_EQ(line["service"], "env_service");
  EXPECT_EQ(line["id"], "env-1");
  EXPECT_TRUE(
      std::regex_match(line["time"].get<std::string>(), std::regex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:]{8}\\.[0-9]{3}Z")))
      << lines;
}

TEST(ServiceLog, JsonBeginsWithTheErrorsOfTheCommandLine) {
  using Options = std::vector<std::string>;
  for (const Options& options :
       {Options{"--domain", "x", "--log-format", "json"}, Options{"--log-format=json", "--none"},
        Options{"--log-level", "off", "--log-format", "json", "--domain"}}) {
    const nlohmann::json line = nlohmann::json::parse(logged("env_service", options, ""), nullptr, false);
    ASSERT_TRUE(line.is_object()) << options.front();
    EXPECT_EQ(line["level"], "critical");
    EXPECT_EQ(line["service"], "env_service");
    EXPECT_TRUE(contains(line["message"], "try --help"));
  }
  EXPECT_TRUE(logged("env_service", {"--domain", "x"}, "").starts_with("env_service: ")) << "text again";
}

TEST(ServiceLog, TheJournalGetsNoTime) {
  EXPECT_EQ(logged("logs_journal", {}, "hot", true), "W [logs_journal] hot\n");
  EXPECT_TRUE(
      std::regex_match(logged("logs_file", {}, "hot"), std::regex("[0-9:]{8}\\.[0-9]{3} W \\[logs_file\\] hot\n")));
}

/// Returns "VALUE, ORIGIN" by the name of each option of a service that was started so.
std::map<std::string, std::string> options_of(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "service");
  std::vector<const char*> given;
  for (const std::string& argument : arguments) given.push_back(argument.c_str());
  CLI::App app;
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  add_settings_file(app);
  Node::Options node;
  bool flag = false;
  std::vector<std::string> files;
  app.add_flag("--flag", flag);
  app.add_flag("--hidden")->group("");
  app.add_option("files", files);
  add_node_options(app, node);
  const int count = static_cast<int>(given.size());
  app.parse(count, given.data());
  std::map<std::string, std::string> found;
  for (const OptionValue& option : option_values(app, count, given.data()))
    found[option.name] = option.value + ", " + option.origin;
  return found;
}

TEST(OptionValues, ANumberSignInQuotesIsNoComment) {
  const Folder folder;
  const std::string file = folder / "options.toml";
  write_file(file, "# first\ndomain = 3 # third\npeers = [\"a#1\", \"b\"]#both\ndiscovery-server = 'x # \"y' # one\n");
  auto options = options_of({"--config", file});
  EXPECT_EQ(options["--domain"], "3, file " + file);
  EXPECT_EQ(options["--peers"], "a#1,b, file " + file);
  EXPECT_EQ(options["--discovery-server"], "x # \"y, file " + file);
}

TEST(OptionValues, SayWhereTheyComeFrom) {
  const Folder folder;
  const std::string file = folder / "options.toml";
  write_file(file, "domain = 3\npeers = [\"a\", \"b\"]\nsession = \"from-file\"\nflag = true\n");
  ::setenv("CITYLEARN_DOMAIN", "4", 1);
  ::setenv("CITYLEARN_MIDDLEWARE", "fastdds", 1);
  auto options = options_of({"x", "--session", "one", "--config", file, "--session=two", "--interface", "lo,eth0"});
  EXPECT_EQ(options["--session"], "two, command line") << "the last one";
  EXPECT_EQ(options["--interface"], "lo,eth0, command line");
  EXPECT_EQ(options["files"], "x, command line");
  EXPECT_EQ(options["--domain"], "3, file " + file) << "goes before the environment";
  EXPECT_EQ(options["--peers"], "a,b, file " + file);
  EXPECT_EQ(options["--flag"], "true, file " + file);
  EXPECT_EQ(options["--middleware"], "fastdds, environment CITYLEARN_MIDDLEWARE");
  EXPECT_EQ(options["--log-format"], "text, default");
  EXPECT_FALSE(options.contains("--help") || options.contains("--config") || options.contains(""));
  options = options_of({"--domain", "5"});
  EXPECT_EQ(options["--domain"], "5, command line");
  ::unsetenv("CITYLEARN_DOMAIN");
  ::unsetenv("CITYLEARN_MIDDLEWARE");
  options = options_of({});
  EXPECT_EQ(options["--domain"], "0, default");
  EXPECT_EQ(options["--interface"], "lo, default");
  EXPECT_EQ(options["--flag"], "false, default");
  EXPECT_EQ(options["--peers"], ", default");
}

/// A limit of `ulimit` ends the process with one line. Without it the kernel or a DDS library would end it silently.
TEST(ServiceLimits, EndWithOneLine) {
  const Folder folder;
  const auto ends_with = [&](__rlimit_resource resource, rlim_t most, const std::string& line) {
    const auto limited_service = [&] {
      ::signal(SIGXFSZ, SIG_DFL);
      const rlimit limit{most, most};
      ::setrlimit(resource, &limit);
      std::string name = "limited";
      char* arguments[] = {name.data(), nullptr};
      std::exit(service_main(
          1, arguments, "A service.", [](CLI::App&) {},
          [&] {
            write_file(folder / "x", std::string(10000, 'x'));
            return 0;
          }));
    };
    EXPECT_EXIT(limited_service(), ::testing::ExitedWithCode(1), line);
  };
  ends_with(RLIMIT_NOFILE, 20, "^limited: ulimit -n: only 20 files may be open at a time .allow 64 or more.\n$");
  ends_with(RLIMIT_FSIZE, 4096, "^limited: " + folder / "x: cannot write it: File too large");
  EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "nothing is written in part";
}

TEST(ServiceLimits, AMemoryLimitInBytesIsTakenForASlip) {
  const auto service = [] {
    std::string name = "limited", option = "--memory-limit=300";
    char* arguments[] = {name.data(), option.data(), nullptr};
    std::exit(service_main(2, arguments, "A service.", add_memory_option, [] { return 0; }));
  };
  EXPECT_EXIT(service(), ::testing::ExitedWithCode(2), "^limited: --memory-limit: less than 64M");
}

/// Threads of libraries have nobody who catches what they throw.
TEST(ServiceLimits, AThreadThatFailsEndsTheServiceWithOneLine) {
  const auto service_of = [](const std::function<void()>& thread, std::string format = "text") {
    std::string name = "limited", option = "--log-format";
    char* arguments[] = {name.data(), option.data(), format.data(), nullptr};
    Node::Options node;
    std::exit(service_main(
        3, arguments, "A service.", [&](CLI::App& app) { add_node_options(app, node); },
        [&] {
          std::thread(thread).join();
          return 0;
        }));
  };
  EXPECT_EXIT(service_of([] { throw std::bad_alloc(); }), ::testing::ExitedWithCode(1), "^[^:]*: out of memory\n$");
  EXPECT_EXIT(service_of([] { throw std::runtime_error("no more"); }), ::testing::ExitedWithCode(1),
              "^[^:]*: unexpected failure of a thread: no more\n$");
  EXPECT_EXIT(service_of([] { std::abort(); }), ::testing::KilledBySignal(SIGABRT),
              "^[^:]*: aborted by a library, in which a check failed\n$");
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // which take all addresses
  const auto without_memory = [] {
    const rlimit limit{1 << 20, 1 << 20};
    ::setrlimit(RLIMIT_AS, &limit);
    std::abort();
  };
  EXPECT_EXIT(service_of(without_memory), ::testing::KilledBySignal(SIGABRT),
              "^[^:]*: aborted by a library, which is out of memory\n$");
#endif
  EXPECT_EXIT(
      service_of([] { throw std::runtime_error("no \"more\""); }, "json"), ::testing::ExitedWithCode(1),
      "^.\"level\":\"critical\",\"service\":\"[^\"]*\",\"message\":\"unexpected failure of a thread: no .more.\".\n$");
}

}  // namespace
}  // namespace citylearn::testing
