// SPDX-License-Identifier: Apache-2.0
#include "training_data.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {

std::string features_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose) {
  if (contents.feature_dimension != others.feature_dimension)
    return fmt::format("has {} features a frame, {} has {}", contents.feature_dimension, whose,
                       others.feature_dimension);
  if (contents.encoder && others.encoder && *contents.encoder != *others.encoder)
    return fmt::format("has features of encoder '{}', {} has those of '{}'", *contents.encoder, whose, *others.encoder);
  return "";
}

std::string contents_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose) {
  if (contents.hash == others.hash) return features_misfit(contents, others, whose);
  const auto about = [](const TraversalContents& one) {
    return fmt::format("({}hash {:016x})", one.frames > 0 ? fmt::format("{} frames, ", one.frames) : "", one.hash);
  };
  return fmt::format("has other contents {} than {} {}", about(contents), whose, about(others));
}

std::vector<std::string> TrainingData::names() const {
  std::vector<std::string> names;
  for (const TraversalContents& one : traversals) names.push_back(one.traversal);
  return names;
}

std::string TrainingData::misfit(const TraversalContents& contents) const {
  if (!known()) return "";
  const auto same = std::find_if(traversals.begin(), traversals.end(),
                                 [&](const auto& one) { return one.traversal == contents.traversal; });
  const std::string whose = "the training";
  const bool elsewhere = same != traversals.end() && same->streets_hash != 0 && contents.streets_hash != 0 &&
                         same->streets_hash != contents.streets_hash;
  return same == traversals.end() || elsewhere ? features_misfit(contents, traversals.front(), whose)
                                               : contents_misfit(contents, *same, whose);
}

std::string TrainingData::remedy(const std::string& traversal) const {
  const auto sibling = source.find("align-to");
  const bool aligned = sibling != source.end() && sibling->second != traversal;
  std::string options;
  for (const auto& [name, value] : source)
    if (aligned || !name.starts_with("align-")) options += " --" + name + " " + value;
  return "take the data and the encoder of the training" + (options.empty() ? "" : ":" + options);
}

std::string TrainingData::text() const {
  if (!known()) return "";
  nlohmann::json all = {{"train", joined(names())}, {"source", source}};
  for (const TraversalContents& one : traversals) {
    all["traversals"][one.traversal] = {{"dataset", one.dataset},
                                        {"hash", fmt::format("{:016x}", one.hash)},
                                        {"frames", one.frames},
                                        {"features", one.feature_dimension},
                                        {"encoder", one.encoder.value_or("")}};
    if (one.streets_hash != 0) all["traversals"][one.traversal]["streets"] = fmt::format("{:016x}", one.streets_hash);
  }
  return all.dump();
}

TrainingData TrainingData::parse(const std::string& text, const std::string& where) try {
  TrainingData data;
  if (text.empty()) return data;
  const nlohmann::json all = parse_json(text, where);
  data.source = all.value("source", data.source);
  std::istringstream names(all.at("train").get<std::string>());
  for (std::string name; std::getline(names >> std::ws, name, ',');) {
    const auto entry = all.at("traversals").find(name);
    if (entry == all.at("traversals").end()) continue;
    TraversalContents& one = data.traversals.emplace_back();
    one.traversal = name;
    one.hash = std::strtoull(entry->value("hash", "0").c_str(), nullptr, 16);
    one.feature_dimension = entry->value("features", 0u);
    one.encoder = entry->value("encoder", "");
    one.dataset = entry->value("dataset", "");
    one.frames = entry->value("frames", 0u);
    one.streets_hash = std::strtoull(entry->value("streets", "0").c_str(), nullptr, 16);
  }
  return data;
} catch (const nlohmann::json::exception&) {
  throw Error("does not say what an agent learned from", where, "name the manifest.json of its run");
}

}  // namespace citylearn
