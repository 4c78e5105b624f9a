// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace citylearn {

/// Loads, for good, a shared object whose static Registrations add to this program's registries
/// (docs/how-to/load-a-plugin.md); Does nothing when it is loaded already. Throws Error naming the file when it is
/// missing, no plug-in, built against another version of this program (none of its code has run then), lacks a library,
/// registers nothing, or a name that exists.
void load_plugin(const std::string& file);

/// Returns the files loaded so far, as they were named.
const std::vector<std::string>& loaded_plugins();

/// Declares --plugin, and loads at once what the command line, the --config file or CITYLEARN_PLUGIN give for it:
/// options declared afterwards may come from the registries. Throws as load_plugin.
void add_plugin_option(CLI::App& app, int argc, char** argv);

}  // namespace citylearn
