// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/demo_command.h"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"

namespace citylearn {

std::vector<std::string> read_words(const std::string& path) {
  std::ifstream file(path);  // read_file() wants to know the size, which a pipe does not have
  if (!file) throw Error("cannot be read", path);
  std::vector<std::string> words;
  for (std::string word; std::getline(file, word, '\0');) words.push_back(word);
  return words;
}

std::vector<std::string> demo_command_of(const std::string& folder) {
  std::error_code none;
  std::filesystem::path path = std::filesystem::path(folder) / "manifest.json";
  for (const auto& entry : std::filesystem::directory_iterator(folder, none))
    if (!std::filesystem::exists(path, none) && std::filesystem::exists(entry.path() / "manifest.json", none))
      path = entry.path() / "manifest.json";
  if (!std::filesystem::exists(path, none))
    throw Error("is no folder of a demo's run (there is no manifest.json)", "'" + folder + "'");
  const nlohmann::json manifest = parse_json_or_null<nlohmann::json>(read_file(path.string()));
  const nlohmann::json words = manifest.is_object() ? manifest.value("demo", nlohmann::json()) : nlohmann::json();
  std::vector<std::string> command;
  for (const nlohmann::json& word : words)
    if (word.is_string()) command.push_back(word);
  if (!words.is_array() || command.size() != words.size())
    throw Error("has no command of a demo in the field 'demo'", path.string(), "name the folder of a demo's run");
  return command;
}

}  // namespace citylearn
