// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/report.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/wire/service.h"

namespace citylearn::vpr {
namespace {

std::string number(double value, const char* format = "%.6g") {
  if (std::isnan(value)) return "nan";
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

std::string share(double value) { return number(value, "%.3f"); }

std::string interval(const Interval& interval) { return share(interval.low) + "-" + share(interval.high); }

nlohmann::json json_of(double value) { return std::isnan(value) ? nlohmann::json() : nlohmann::json(value); }

}  // namespace

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == text.npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string table(const std::vector<Row>& rows) {
  std::vector<std::vector<std::string>> cells = {{"encoder", "dim", "centring", "method", "query", "R@1", "(95 %)",
                                                  "R@5", "R@10", "AUC", "(95 %)", "encode s", "match s"}};
  for (const Row& row : rows)
    cells.push_back({row.encoder, std::to_string(row.dimension), row.centring, row.method, row.query,
                     share(row.recall_1), interval(row.recall_1_interval), share(row.recall_5), share(row.recall_10),
                     share(row.auc), interval(row.auc_interval), number(row.encode_seconds, "%.1f"),
                     number(row.seconds, "%.1f")});
  std::vector<std::size_t> widths(cells[0].size());
  for (const auto& line : cells)
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string text;
  for (const auto& line : cells) {
    std::string out;
    for (std::size_t i = 0; i < line.size(); ++i) {
      const std::string blanks(widths[i] - line[i].size(), ' ');
      const bool word = i == 0 || (i >= 2 && i <= 4);
      out += (i ? "  " : "") + (word ? line[i] + blanks : blanks + line[i]);
    }
    text += out + "\n";
  }
  return text;
}

std::string results_csv(const std::vector<Row>& rows) {
  std::string text =
      "encoder,name,dimension,pca,centring,whitening,method,query,condition,references,queries,tolerance,recall_1,"
      "recall_1_low,recall_1_high,recall_5,recall_10,auc,auc_low,auc_high,recall_at_full_precision,encode_seconds,"
      "seconds\n";
  for (const Row& row : rows) {
    text += csv_field(row.encoder) + "," + csv_field(row.name) + "," + std::to_string(row.dimension) + "," +
            (row.reduced ? "1" : "0") + "," + row.centring + "," + number(row.whitening) + "," + row.method + "," +
            csv_field(row.query) + "," + csv_field(row.condition) + "," + std::to_string(row.references) + "," +
            std::to_string(row.queries) + "," + std::to_string(row.tolerance);
    for (const double value :
         {row.recall_1, row.recall_1_interval.low, row.recall_1_interval.high, row.recall_5, row.recall_10, row.auc,
          row.auc_interval.low, row.auc_interval.high, row.recall_at_full_precision, row.encode_seconds, row.seconds})
      text += "," + number(value);
    text += "\n";
  }
  return text;
}

std::string results_json(const Setting& setting, const std::vector<Row>& rows) {
  nlohmann::ordered_json json = {
      {"program", "citylearn_vpr " + version()},
      {"command", setting.command},
      {"dataset", setting.dataset},
      {"data", setting.folder},
      {"reference", setting.reference},
      {"ground_truth", setting.ground_truth},
      {"measure", setting.measure},
      {"definitions",
       {{"recall_n",
         "share of the queries that have a true place with a right frame among the n most similar ones; "
         "equally similar wrong frames come first"},
        {"recall_1_interval", "95 %, Wilson"},
        {"auc",
         "area under precision over recall of the best answers, sorted by confidence, equal confidences one "
         "threshold, trapezoids from recall 0 (with the first precision) to the last recall"},
        {"auc_interval", "95 %, circular block bootstrap over queries, blocks of sqrt(Q), 500 resamples"}}},
      {"rows", nlohmann::ordered_json::array()}};
  for (const Row& row : rows)
    json["rows"].push_back({{"encoder", row.encoder},
                            {"name", row.name},
                            {"dimension", row.dimension},
                            {"pca", row.reduced},
                            {"centring", row.centring},
                            {"whitening", row.whitening},
                            {"method", row.method},
                            {"query", row.query},
                            {"condition", row.condition},
                            {"references", row.references},
                            {"queries", row.queries},
                            {"tolerance", row.tolerance},
                            {"recall_1", json_of(row.recall_1)},
                            {"recall_1_interval", {row.recall_1_interval.low, row.recall_1_interval.high}},
                            {"recall_5", json_of(row.recall_5)},
                            {"recall_10", json_of(row.recall_10)},
                            {"auc", row.auc},
                            {"auc_interval", {row.auc_interval.low, row.auc_interval.high}},
                            {"recall_at_full_precision", row.recall_at_full_precision},
                            {"encode_seconds", row.encode_seconds},
                            {"seconds", row.seconds}});
  return json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

std::string curves_json(const std::vector<Row>& rows) {
  constexpr std::size_t kMost = 2000;
  nlohmann::ordered_json json = {{"curves", nlohmann::ordered_json::array()}};
  for (const Row& row : rows) {
    const std::size_t size = row.curve.recall.size(), kept = std::min(size, kMost);
    std::vector<double> recall(kept), precision(kept);
    for (std::size_t i = 0; i < kept; ++i) {
      // The first and the last point are always among them.
      const std::size_t point = kept > 1 ? i * (size - 1) / (kept - 1) : 0;
      recall[i] = row.curve.recall[point];
      precision[i] = row.curve.precision[point];
    }
    json["curves"].push_back({{"encoder", row.encoder},
                              {"dimension", row.dimension},
                              {"centring", row.centring},
                              {"method", row.method},
                              {"query", row.query},
                              {"auc", row.auc},
                              {"recall", recall},
                              {"precision", precision}});
  }
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
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
