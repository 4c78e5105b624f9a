// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/plugin/registry.h"
#include "core/wire/node.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Puts the options that are added to `app` while it lives under a heading of --help.
class OptionGroup {
 public:
  OptionGroup(CLI::App& app, const std::string& name);
  ~OptionGroup();
  OptionGroup(const OptionGroup&) = delete;
  OptionGroup& operator=(const OptionGroup&) = delete;

 private:
  CLI::App& app_;
  const std::string before_;
};

/// Options that every service has: --session, --id, --middleware, --domain, --interface, --peers, --discovery-server,
/// --security, --config, --log-level, --log-format. Precedence: command line, then --config FILE (TOML, the same names
/// without dashes), then environment (CITYLEARN_SESSION, CITYLEARN_MIDDLEWARE, CITYLEARN_DOMAIN, CITYLEARN_INTERFACE,
/// CITYLEARN_PEERS, CITYLEARN_DISCOVERY_SERVER, CITYLEARN_SECURITY, CITYLEARN_LOG_FORMAT), then the default.
/// `options.service` and `options.id` are the defaults to begin with.
void add_node_options(CLI::App& app, Node::Options& options);

/// Adds --metrics (CITYLEARN_METRICS), for services that make a Node.
void add_metrics_option(CLI::App& app, Node::Options& options);

/// Adds --memory-limit (CITYLEARN_MEMORY_LIMIT). service_main starts a program that has it anew, in the same process,
/// soon after it holds more memory than this, or else than three quarters of the machine's.
void add_memory_option(CLI::App& app);

/// Counts the memory of this child process for --memory-limit, too. A new start of the program kills its group.
void count_memory_of(int child);

/// Adds an option `--PREFIX-NAME` for each parameter of a plug-in. `values` gets the given ones, without the prefix.
void add_parameters(CLI::App& app, const std::string& prefix, const std::vector<ParameterSpec>& specs,
                    std::map<std::string, double>& values);

/// Returns the text of `--list`: each plug-in with its help and parameters (default, range).
std::string describe(const std::string& name, const std::string& help, const std::vector<ParameterSpec>& specs,
                     const std::string& prefix);

/// An option after the command line was parsed.
struct OptionValue {
  std::string name;    ///< "--domain"; a positional argument has no dashes
  std::string value;   ///< as text; empty: it has none
  std::string origin;  ///< "command line", "file FILE" (of --config), "environment NAME" or kDefaultOrigin
};
inline constexpr const char* kDefaultOrigin = "default";

/// Returns all options of a parsed `app` but --help, --help-all, --version, --config and hidden ones, in the order in
/// which they were added.
std::vector<OptionValue> option_values(const CLI::App& app, int argc, const char* const* argv);

/// The body of every `main`: builds the command line with `setup`, parses it, runs `body` and returns its exit status.
/// SIGTERM and SIGINT set stop_requested(). A wrong command line or an Error becomes one line on standard error and
/// status 2 or 1. `summary` is the first line of --help.
int service_main(int argc, char** argv, const std::string& summary, const std::function<void(CLI::App&)>& setup,
                 const std::function<int()>& body);

/// Returns whether SIGTERM or SIGINT has arrived: the program must leave within 2 seconds.
bool stop_requested();

}  // namespace citylearn
