// SPDX-License-Identifier: Apache-2.0
#include "core/plugin/plugins.h"

#include <dlfcn.h>
#include <elf.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstring>
#include <filesystem>
#include <functional>

#include "core/command_line/settings_file.h"
#include "core/files/files.h"
#include "core/plugin/plugin_stamp.h"
#include "core/plugin/registry.h"

namespace citylearn {
namespace {

struct Loaded {
  std::vector<std::string> named;
  std::vector<std::filesystem::path> canonical;
};

Loaded& loaded() {
  static Loaded all;
  return all;
}

/// Throws Error unless the plug-in was built for this program. Reads its file, as loading it would run its code.
void check_stamp(const std::string& file) {
  const std::string contents = read_file(file), mark = CITYLEARN_PLUGIN_MARK;
  const bool shared = contents.size() > sizeof(Elf64_Ehdr) && contents.starts_with(ELFMAG);
  const std::size_t found = shared ? contents.find(mark) : std::string::npos;
  if (found == std::string::npos)
    throw Error("is not a plug-in of this program", "plug-in " + file,
                "docs/how-to/load-a-plugin.md tells how one is built");
  Elf64_Ehdr header;  // the table of sections stands last
  std::memcpy(&header, contents.data(), sizeof(header));
  if (header.e_shoff > contents.size() ||
      contents.size() - header.e_shoff < std::size_t{header.e_shnum} * header.e_shentsize)
    throw Error("is cut short", "plug-in " + file, "build or copy it again");
  const std::size_t begin = found + mark.size(), end = contents.find('\0', begin);
  const std::string build = contents.substr(begin, std::min(end, begin + 200) - begin);
  if (build != CITYLEARN_BUILD)
    throw Error("was built for " + build + "; this program is " + CITYLEARN_BUILD, "plug-in " + file,
                "build both from the same sources, alike");
}

void declare(CLI::App& app, const std::function<void(const std::vector<std::string>&)>& given) {
  app.add_option_function(
         "--plugin", given,
         "Shared objects with more learners, encoders, datasets ...: FILE,... (docs/how-to/load-a-plugin.md)")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->take_all()
      ->type_name("FILE")
      ->envname("CITYLEARN_PLUGIN");
}

}  // namespace

void load_plugin(const std::string& file) {
  const std::filesystem::path path = std::filesystem::weakly_canonical(file);
  auto& known = loaded().canonical;
  if (std::find(known.begin(), known.end(), path) != known.end()) return;
  if (!std::filesystem::is_regular_file(path)) throw Error("there is no such file", "plug-in " + file);
  check_stamp(path);
  const Registrations before = registrations();
  if (!dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) {
    const char* text = dlerror();
    const std::string reason = text ? text : "no reason given";
    throw Error("cannot be loaded: " + reason, "plug-in " + file,
                reason.find("undefined symbol") == std::string::npos
                    ? ""
                    : "it may be for another program: docs/how-to/load-a-plugin.md");
  }
  const Registrations& after = registrations();
  if (after.taken.size() > before.taken.size())
    throw Error("registers '" + after.taken.back() + "', which exists already", "plug-in " + file,
                "give it another name");
  if (after.count == before.count) throw Error("registers nothing", "plug-in " + file);
  known.push_back(path);
  loaded().named.push_back(file);
}

const std::vector<std::string>& loaded_plugins() { return loaded().named; }

void add_plugin_option(CLI::App& app, int argc, char** argv) {
  std::vector<std::string> files;
  CLI::App scan;  // for this one option: the others are not known yet
  scan.set_help_flag();
  scan.allow_extras();
  scan.allow_config_extras(CLI::config_extras_mode::ignore_all);
  add_settings_file(scan);
  declare(scan, [&files](const std::vector<std::string>& all) { files = all; });
  try {
    scan.parse(argc, argv);
  } catch (const CLI::ParseError&) {
    files.clear();  // parsing the whole command line will say it better
  }
  for (const std::string& file : files) load_plugin(file);
  declare(app, [](const std::vector<std::string>&) {});
}

}  // namespace citylearn
