// SPDX-License-Identifier: Apache-2.0
// What differs between runs.
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/files/json.h"
#include "core/util/text.h"
#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"
#include "dashboard/api/tables.h"
#include "dashboard/query/comparison.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostCompared = 64;

Json rows_json(const std::vector<ComparedFact>& facts, bool all) {
  Json rows = Json::array();
  for (const ComparedFact& fact : facts) {
    if (!fact.differs && !all) continue;
    Json values = Json::array();
    for (const auto& value : fact.values) values.push_back(value ? Json(*value) : Json(nullptr));
    rows.push_back({{"key", fact.key}, {"values", std::move(values)}, {"differs", fact.differs}});
  }
  return rows;
}

}  // namespace

Answer Api::compare(const Query& query) {
  allow_only(query, {"runs", "all"});
  const std::string given = text_parameter(query, "runs").value_or("");
  const bool all = flag_parameter(query, "all").value_or(false);
  std::vector<std::string> names;
  for (std::size_t begin = 0; begin < given.size();) {
    const std::size_t end = std::min(given.find('\n', begin), given.size());
    names.push_back(given.substr(begin, end - begin));
    begin = end + 1;
  }
  if (names.empty() || names.size() > kMostCompared)
    throw RequestError(400, "parameter 'runs' must be 1 to " + std::to_string(kMostCompared) + " IDs, one a line");
  std::vector<RunFacts> config, figures;
  BorrowedReader reader(*this);
  for (const std::string& name : names) {
    const auto row = reader->run(name);
    if (!row) not_found("run '" + name + "' not found (GET /api/runs lists them)");
    RunFacts& options = config.emplace_back();
    add_json_leaves(options, reader->manifest(row->id));
    std::erase_if(options, [](const auto& one) { return one.first.starts_with("artefacts."); });  // where its files are
    RunFacts& final = figures.emplace_back();
    const auto add = [&final](const std::string& key, double value) {
      if (!std::isfinite(value)) return;
      final[key].clear();
      append_number(final[key], value);
    };
    if (row->newest) {
      add("reward", static_cast<float>(row->newest->reward));
      add("spl", static_cast<float>(row->newest->spl));
      add("steps", static_cast<double>(row->newest->steps));
      add("episodes", static_cast<double>(row->newest->episodes));
      add("wall", row->newest->wall);
    }
  }
  return json_answer({{"runs", names},
                      {"config", rows_json(citylearn::compare(config), all)},
                      {"figures", rows_json(citylearn::compare(figures), all)}});
}

}  // namespace citylearn
