// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/report.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "core/files/csv.h"
#include "core/util/version.h"

namespace citylearn::vpr {
namespace {

using Json = nlohmann::ordered_json;

std::string number(double value, const char* format = "{:.6g}") {
  return std::isnan(value) ? "nan" : fmt::format(fmt::runtime(format), value);
}

std::string cell(const Json& value) {
  if (value.is_string()) return csv_field(value.get<std::string>());
  if (value.is_boolean()) return value ? "1" : "0";
  return value.is_number_float() ? number(value) : value.dump();
}

/// Returns at most 2,000 of the points, always with the first and the last one.
std::vector<double> thinned(const std::vector<double>& points) {
  std::vector<double> kept(std::min<std::size_t>(points.size(), 2000));
  for (std::size_t i = 0; i < kept.size(); ++i)
    kept[i] = points[kept.size() > 1 ? i * (points.size() - 1) / (kept.size() - 1) : 0];
  return kept;
}

std::string dumped(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace

std::string table(const std::vector<Row>& rows) {
  std::vector<std::vector<std::string>> cells = {{"encoder", "dim", "centring", "method", "query", "R@1", "(95 %)",
                                                  "R@5", "R@10", "R@20", "AUC", "(95 %)", "encode s", "match s"}};
  for (const Row& row : rows) {
    std::vector<std::string>& line = cells.emplace_back();
    for (const char* name :
         {"encoder", "dimension", "centring", "method", "query", "recall_1", "recall_1_interval", "recall_5",
          "recall_10", "recall_20", "auc", "auc_interval", "encode_seconds", "seconds"}) {
      const Json& fact = row.facts[name];
      const auto figure = [](const Json& of) { return number(of.get<double>(), "{:.3f}"); };
      line.push_back(fact.is_string()          ? fact.get<std::string>()
                     : fact.is_array()         ? figure(fact[0]) + "-" + figure(fact[1])
                     : !fact.is_number_float() ? fact.dump()
                     : line.size() < 12        ? figure(fact)
                                               : number(fact.get<double>(), "{:.1f}"));
    }
  }
  std::vector<std::size_t> widths(cells[0].size());
  for (const auto& line : cells)
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string text;
  for (const auto& line : cells) {
    for (std::size_t i = 0; i < line.size(); ++i) {
      const bool word = i == 0 || (i >= 2 && i <= 4);
      text += (i ? "  " : "") + fmt::format(fmt::runtime(word ? "{:<{}}" : "{:>{}}"), line[i], widths[i]);
    }
    text += "\n";
  }
  return text;
}

std::string results_csv(const std::vector<Row>& rows) {
  std::string header, text;
  for (const Row& row : rows) {
    std::string names, values;
    const auto add = [&](const std::string& name, const Json& value) {
      names += (names.empty() ? "" : ",") + name;
      values += (values.empty() ? "" : ",") + cell(value);
    };
    for (const auto& [name, value] : row.facts.items())
      if (value.is_array()) {
        const std::string of = name.substr(0, name.rfind('_'));  // "auc_interval": auc_low, auc_high
        add(of + "_low", value[0]);
        add(of + "_high", value[1]);
      } else {
        add(name, value);
      }
    header = names;
    text += values + "\n";
  }
  return header + "\n" + text;
}

std::string results_json(const Options& options, const std::vector<Row>& rows) {
  const Measure measure = options.matching.measure;
  Json json = {
      {"program", "citylearn_vpr " + version()},
      {"command", options.command},
      {"dataset", options.source.dataset},
      {"data", options.source.folder},
      {"reference", options.source.traversal},
      {"ground_truth", options.radius > 0 ? "frames within " + number(options.radius) + " m"
                                          : "frame i of the query shows the place of frame i of the reference"},
      {"measure", measure == Measure::kCosine ? "cosine" : "l1"},
      {"definitions",
       {{"recall_n",
         "share of the queries that have a true place with a right frame among the n most similar ones; "
         "equally similar wrong frames come first"},
        {"recall_1_interval", "95 %, Wilson"},
        {"auc",
         "area under precision over recall of the best answers, sorted by confidence, equal confidences one "
         "threshold, trapezoids from recall 0 (with the first precision) to the last recall"},
        {"auc_interval", "95 %, circular block bootstrap over queries, blocks of sqrt(Q), 500 resamples"}}},
      {"rows", Json::array()}};
  for (const Row& row : rows) json["rows"].push_back(row.facts);
  return dumped(json, 2);
}

std::string curves_json(const std::vector<Row>& rows) {
  Json json = {{"curves", Json::array()}};
  for (const Row& row : rows) {
    Json curve = {{"recall", thinned(row.curve.recall)}, {"precision", thinned(row.curve.precision)}};
    for (const char* name : {"encoder", "dimension", "centring", "method", "query", "auc"})
      curve[name] = row.facts[name];
    curve["file"] = "pr-" + slug(row.facts["query"]) + "-" + slug(row.facts["method"]) + ".svg";
    if (!row.matches.empty()) curve["matches"] = row.matches;
    json["curves"].push_back(std::move(curve));
  }
  return dumped(json, -1);
}

std::string slug_of(const Row& row) {
  const Json& f = row.facts;
  return slug(f["encoder"]) + "-" + f["dimension"].dump() + "-" + f["centring"].get<std::string>() + "-" +
         slug(f["query"]) + "-" + slug(f["method"]);
}

std::string slug(const std::string& text) {
  std::string result;
  for (const char c : text) {
    const bool fine = std::isalnum(static_cast<unsigned char>(c)) || c == '_' || (c == '.' && !result.empty());
    result += fine ? c : '-';
  }
  return result;
}

}  // namespace citylearn::vpr
