// SPDX-License-Identifier: Apache-2.0
#include "core/wire/service.h"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <mutex>
#include <set>
#include <thread>

#include "core/command_line/help_text.h"
#include "core/command_line/number_check.h"
#include "core/command_line/settings_file.h"
#include "core/util/log_format.h"
#include "core/util/machine.h"
#include "core/util/name.h"
#include "core/util/version.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kMinMemoryLimit = 64 << 20;
/// Less time than a process needs to take a tenth of a machine's memory.
constexpr std::chrono::milliseconds kMemoryCheckInterval{50};

volatile std::sig_atomic_t stop_signal = 0;
std::atomic<int> counted_child = -1;

extern "C" void on_stop_signal(int signal) { stop_signal = signal; }

/// Ends the process with one line when an exception is not caught: threads of the DDS libraries run out of memory, too.
[[noreturn]] void on_terminate() {
  try {
    if (const std::exception_ptr thrown = std::current_exception()) std::rethrow_exception(thrown);
    print_last_line(program_invocation_short_name, "ended by a library");
  } catch (const std::bad_alloc&) {
    print_last_line(program_invocation_short_name, "out of memory");
  } catch (const std::exception& error) {
    print_last_line(program_invocation_short_name, "unexpected failure of a thread: ", error.what());
  } catch (...) {
    print_last_line(program_invocation_short_name, "unexpected failure of a thread");
  }
  std::_Exit(1);
}

/// Prints why a DDS library aborted: Cyclone DDS does so silently when memory is short; Fast DDS names a fault of its
/// own. The process then ends as it would have.
extern "C" void on_abort(int) {
  constexpr std::size_t kReserve = 64 << 20;
  const bool room = mmap(nullptr, kReserve, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED;
  print_last_line(program_invocation_short_name, room ? "aborted by a library, in which a check failed"
                                                      : "aborted by a library, which is out of memory");
}

void install_handlers() {
  struct sigaction action {};
  action.sa_handler = on_stop_signal;
  action.sa_flags = SA_ONSTACK;  // threads that multiply matrices need it: policy_service/network/layers/product.cc
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGABRT, on_abort);
  std::set_terminate(on_terminate);
  std::signal(SIGXFSZ, SIG_IGN);  // a file beyond `ulimit -f` is an error of its write, as on a full disk
}

/// Returns the bytes that a process holds for itself; 0 where /proc is not mounted. Mapped files do not count, because
/// the kernel drops their pages when it needs room.
std::uint64_t held_memory(const std::string& process) {
  std::uint64_t size = 0, resident = 0, shared = 0;
  std::ifstream("/proc/" + process + "/statm") >> size >> resident >> shared;
  return (resident - shared) * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::uint64_t most_of_the_memory() {
  return static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) / 4 * 3 *
         static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

/// Starts the program anew, in this process, soon after it holds more than `limit` bytes. Nothing is saved or sent, as
/// if it was killed. The thread does this until it is destroyed.
std::jthread restart_beyond(std::uint64_t limit, std::vector<std::string> arguments) {
  return std::jthread([limit, arguments](const std::stop_token& stop) mutable {
    std::error_code unknown;
    const std::string program = std::filesystem::read_symlink("/proc/self/exe", unknown);
    std::vector<char*> words;
    for (std::string& argument : arguments) words.push_back(argument.data());
    words.push_back(nullptr);
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any stopped;
    while (!stopped.wait_for(lock, stop, kMemoryCheckInterval, [&stop] { return stop.stop_requested(); })) {
      const int child = counted_child;
      siginfo_t ended;
      const bool has_child = child > 0 && waitid(P_PID, child, &ended, WEXITED | WNOHANG | WNOWAIT) == 0;
      const std::uint64_t held = held_memory("self") + (has_child ? held_memory(std::to_string(child)) : 0);
      if (held <= limit) continue;
      const std::string line =
          fmt::format("starts again, as it holds {} MB of memory, more than its limit of {} MB (--memory-limit)",
                      held >> 20, limit >> 20);
      print_last_line(program_invocation_short_name, line.c_str());
      if (has_child && kill(-child, SIGKILL) == 0) waitpid(child, nullptr, 0);  // before its owner misses it
      close_range(STDERR_FILENO + 1, ~0U, 0);
      execv(program.c_str(), words.data());
      std::_Exit(1);
    }
  });
}

/// Returns the words with which a program goes on where it was: one that can, and has a folder, from what is in there.
std::vector<std::string> words_to_go_on(const CLI::App& app, int argc, char** argv) {
  std::vector<std::string> words(argv, argv + argc);
  std::erase(words, "--overwrite");
  const CLI::Option *resume = app.get_option_no_throw("--resume"), *output = app.get_option_no_throw("--output");
  if (resume && resume->count() == 0 && output->count() > 0) words.emplace_back("--resume");
  return words;
}

/// Throws Error when too few files may be open, because the DDS libraries then crash.
void check_file_limit() {
  constexpr rlim_t kMinOpenFiles = 64;
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur < kMinOpenFiles)
    throw Error("only " + std::to_string(files.rlim_cur) + " files may be open at a time", "ulimit -n",
                "allow " + std::to_string(kMinOpenFiles) + " or more");
}

// A program built with -march=native must say so on a lesser processor instead of dying of an illegal instruction.
void check_processor() {
#ifdef __AVX512F__
  if (!__builtin_cpu_supports("avx512f"))
    throw Error("built for a processor with AVX-512, which this one lacks", "", "build with -DCITYLEARN_NATIVE=OFF");
#elif defined(__AVX2__)
  if (!__builtin_cpu_supports("avx2"))
    throw Error("built for a processor with AVX2, which this one lacks", "", "compile for this machine");
#endif
}

std::string short_number(double value) {
  std::ostringstream text;
  text.precision(10);
  text << value;
  return text.str();
}

/// Returns "[DEFAULT; MINIMUM..MAXIMUM]".
std::string range_of(const ParameterSpec& spec) {
  return std::string("[") + (spec.recommended ? "what the agent recommends, see --show-config; else " : "") +
         short_number(spec.default_value) + "; " + short_number(spec.minimum) + ".." + short_number(spec.maximum) + "]";
}

/// Returns whether the arguments name the option; CLI11 does not say where a value comes from.
bool on_command_line(const CLI::Option& option, int argc, const char* const* argv) {
  return std::any_of(argv + 1, argv + argc, [&option](std::string argument) {
    argument = argument.substr(0, argument.find('='));
    return argument.starts_with("--") && option.check_name(argument);
  });
}

/// Returns whether the command line, or else the environment, asks for a log of JSON.
bool asks_for_json(int argc, const char* const* argv) {
  const char* environment = std::getenv("CITYLEARN_LOG_FORMAT");
  std::string format = environment ? environment : "";
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i], option = "--log-format";
    if (argument.starts_with(option + "=")) format = argument.substr(option.size() + 1);
    if (argument == option && i + 1 < argc) format = argv[i + 1];
  }
  return format == "json";
}

std::string value_of(const CLI::Option& option) {
  if (option.count() == 0) return option.get_items_expected_max() == 0 ? "false" : default_text(option);
  return option.get_items_expected_max() <= 1 ? option.results().back() : CLI::detail::join(option.results(), ",");
}

}  // namespace

OptionGroup::OptionGroup(CLI::App& app, const std::string& name)
    : app_(app), before_(app.option_defaults()->get_group()) {
  app_.option_defaults()->group(name);
}

OptionGroup::~OptionGroup() { app_.option_defaults()->group(before_); }

bool stop_requested() {
  if (Machine* machine = Machine::simulated()) return machine->stop_requested();
  return stop_signal != 0;
}

void add_node_options(CLI::App& app, Node::Options& options) {
  const OptionGroup group(app, "Service");
  MiddlewareOptions& middleware = options.middleware;
  const std::string names = joined(list_middlewares(), &std::pair<std::string, std::string>::first);
  app.add_option("--session", options.session,
                 "Session this service belongs to; services of other sessions are ignored")
      ->capture_default_str()
      ->envname("CITYLEARN_SESSION")
      ->check(name_problem);
  auto* id = app.add_option("--id", options.id, "Name of this service, unique within the session")->check(name_problem);
  if (!options.id.empty()) id->capture_default_str();
  app.add_option("--middleware", middleware.name, "One of " + names + "; lossy:NAME loses messages, for tests")
      ->capture_default_str()
      ->envname("CITYLEARN_MIDDLEWARE");
  app.add_option("--domain", middleware.domain, "DDS domain")
      ->capture_default_str()
      ->envname("CITYLEARN_DOMAIN")
      ->check(CLI::Range(0, 232));
  app.add_option("--interface", middleware.interfaces,
                 "The only network interfaces used, by name or IPv4 address: A,B,...; lo stays on this machine")
      ->delimiter(',')
      ->capture_default_str()
      ->envname("CITYLEARN_INTERFACE");
  app.add_option("--peers", middleware.peers,
                 "Other hosts to find services on: HOST[:PORT],...; all addresses of a name count, and dns:NAME may "
                 "have none yet")
      ->delimiter(',')
      ->envname("CITYLEARN_PEERS");
  app.add_option("--discovery-server", middleware.discovery_servers,
                 "Fast DDS discovery servers to find services by, instead of --peers: HOST[:PORT],... (port 11811)")
      ->delimiter(',')
      ->envname("CITYLEARN_DISCOVERY_SERVER");
  app.add_option("--security", middleware.security,
                 "Folder with this service's keys (docs/how-to/secure-a-run.md); services without keys are refused")
      ->envname("CITYLEARN_SECURITY");
  app.add_option_function<std::string>(
         "--log-level", [](const std::string& level) { spdlog::set_level(spdlog::level::from_str(level)); },
         "Least severe messages that are logged")
      ->default_str(spdlog::level::to_string_view(spdlog::get_level()).data())
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error", "off"}));
  app.add_option_function<std::string>(
         "--log-format",
         [&options](const std::string& format) {
           set_log_identity({options.session, options.service, options.id});
           if (format == "json") use_json_log();
         },
         "json: one object a line")
      ->default_str("text")
      ->envname("CITYLEARN_LOG_FORMAT")
      ->check(CLI::IsMember({"text", "json"}));
}

void add_metrics_option(CLI::App& app, Node::Options& options) {
  const OptionGroup group(app, "Service");
  app.add_option("--metrics", options.metrics,
                 "Serve figures for Prometheus (/metrics) and health (/healthz, /livez) on this port; without an "
                 "address to this machine alone; 0 picks a free port")
      ->type_name("[ADDRESS:]PORT")
      ->envname("CITYLEARN_METRICS")
      ->check(metrics_address_problem);
}

void count_memory_of(int child) { counted_child = child; }

void add_memory_option(CLI::App& app) {
  const OptionGroup group(app, "Service");
  app.add_option("--memory-limit")
      ->description("Start again when it holds more memory than this, as 4G; unless given, 3/4 of the machine's")
      ->type_name("SIZE")
      ->envname("CITYLEARN_MEMORY_LIMIT")
      ->transform(CLI::AsSizeValue(false).description(""))
      ->check([](const std::string& bytes) {
        return std::stoull(bytes) < kMinMemoryLimit ? "less than 64M, as no service can live with" : std::string();
      });
}

void add_parameters(CLI::App& app, const std::string& prefix, const std::vector<ParameterSpec>& specs,
                    std::map<std::string, double>& values) {
  for (const ParameterSpec& spec : specs) {
    const std::string help = spec.help + " " + range_of(spec);
    app.add_option_function<double>(
           "--" + prefix + "-" + spec.name, [&values, name = spec.name](double value) { values[name] = value; }, help)
        ->check(CLI::Range(spec.minimum, spec.maximum))
        ->group(prefix)
        ->type_name(spec.integer ? "INT" : "FLOAT");
  }
}

std::string describe(const std::string& name, const std::string& help, const std::vector<ParameterSpec>& specs,
                     const std::string& prefix) {
  std::string text = "  " + name + std::string(name.size() < 16 ? 16 - name.size() : 1, ' ') + help + "\n";
  for (const ParameterSpec& spec : specs) {
    const std::string option = "--" + prefix + "-" + spec.name;
    text += "      " + option + std::string(option.size() < 34 ? 34 - option.size() : 1, ' ') + spec.help + " " +
            range_of(spec) + "\n";
  }
  return text;
}

std::vector<OptionValue> option_values(const CLI::App& app, int argc, const char* const* argv) {
  std::string file;
  std::set<const CLI::Option*> in_file;
  if (const CLI::Option* config = app.get_config_ptr(); config && config->count() > 0) {
    file = config->results().back();
    for (const CLI::ConfigItem& item : app.get_config_formatter()->from_file(file))
      in_file.insert(app.get_option_no_throw("--" + item.fullname()));
  }
  std::vector<OptionValue> values;
  for (const CLI::Option* option : app.get_options()) {
    if (option == app.get_help_ptr() || option == app.get_help_all_ptr() || option == app.get_version_ptr() ||
        option == app.get_config_ptr() || option->get_name().empty())  // hidden from --help
      continue;
    std::string origin = "command line";
    if (option->count() == 0)
      origin = kDefaultOrigin;
    else if (!on_command_line(*option, argc, argv) && in_file.contains(option))
      origin = "file " + file;
    else if (!on_command_line(*option, argc, argv) && !option->get_envname().empty())
      origin = "environment " + option->get_envname();
    values.push_back({option->get_name(), value_of(*option), origin});
  }
  return values;
}

int service_main(int argc, char** argv, const std::string& summary, const std::function<void(CLI::App&)>& setup,
                 const std::function<int()>& body) {
  const std::string program = std::string(argv[0]).substr(std::string(argv[0]).find_last_of('/') + 1);
  const auto complain = [&program](std::string text, int status) {
    text.erase(text.find_last_not_of("\n ") + 1);
    if (!is_json_log()) {
      std::cerr << program << ": " << one_line(text) << std::endl;
      return status;
    }
    spdlog::set_level(spdlog::level::critical);  // whatever --log-level says
    spdlog::critical("{}", one_line(text));
    return status;
  };
  try {
    check_processor();
    check_file_limit();
    if (!Machine::simulated()) {  // there, programs share them
      install_handlers();
      spdlog::set_default_logger(spdlog::stderr_color_mt(program));
      set_log_identity({"", program, ""});
      if (asks_for_json(argc, argv))  // now, as errors of the command line are lines too
        use_json_log();
      else
        use_text_log(isatty(STDERR_FILENO) == 1);
    }
    CLI::App app(summary, program);
    app.option_defaults()->multi_option_policy(
        CLI::MultiOptionPolicy::TakeLast);  // scripts append their user's options
    app.set_version_flag("--version", version());
    add_settings_file(app, "TOML file with the same options, names without dashes");
    app.allow_config_extras(CLI::config_extras_mode::error);
    setup(app);
    check_numbers(app);
    add_help(app);
    try {
      app.parse(argc, argv);
    } catch (const CLI::Success& done) {
      return app.exit(done);
    } catch (const CLI::ParseError& error) {
      return complain(std::string(error.what()) + " (try --help)", 2);
    }
    std::jthread guard;
    if (const CLI::Option* limit = app.get_option_no_throw("--memory-limit"); limit && !Machine::simulated())
      guard = restart_beyond(limit->count() > 0 ? limit->as<std::uint64_t>() : most_of_the_memory(),
                             words_to_go_on(app, argc, argv));
    return body();
  } catch (const Error& error) {
    return complain(error.what(), 1);
  } catch (const std::bad_alloc&) {
    return complain("out of memory", 1);
  } catch (const std::exception& error) {
    return complain(std::string("unexpected failure: ") + error.what(), 1);
  }
}

}  // namespace citylearn
