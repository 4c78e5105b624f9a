// SPDX-License-Identifier: Apache-2.0
// ./run paper as a program: the whole quick report on a small drawn city, trained for a moment.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <regex>

#include "core/util/sha256.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"
#include "tools/paper/work.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;
using paper::Json;

constexpr seconds kLongWait{600};

/// A folder, and ./run paper that writes into it.
class PaperReport : public ::testing::Test {
 protected:
  Arguments command(const Arguments& more, const std::string& output = "report") const {
    return Arguments{CITYLEARN_PAPER, "--quick", "--effort", "0.004", "--seeds", "1", "--synthetic-frames", "160"} +
           Arguments{"--store", folder_ / "store", "--output", folder_ / output} + more;
  }
  /// Runs it to its end: what it says.
  std::string run(const std::vector<std::string>& more, int status = 0, const std::string& output = "report") const {
    Service program(command(more, output), folder_ / "log");
    EXPECT_EQ(program.wait(kLongWait), status) << program.output();
    return program.output();
  }
  std::string file(const std::string& name, const std::string& output = "report") const {
    return contents(folder_ / (output + "/" + name));
  }
  std::vector<fs::path> outcomes() const {
    std::vector<fs::path> found;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder_ / "report/work", none))
      if (entry.path().extension() == ".json") found.push_back(entry.path());
    return found;
  }

  const Folder folder_;
};

/// Returns a section's part of the report, from its heading to the next.
std::string part(const std::string& html, const std::string& section) {
  const std::size_t begin = html.find("<h2 id=\"" + section + "\">");
  return begin == html.npos ? "" : html.substr(begin, html.find("<h2 ", begin + 1) - begin);
}

/// Tables of a part, each as its rows of fields, without headings.
std::vector<std::vector<std::vector<std::string>>> tables(const std::string& part) {
  std::vector<std::vector<std::vector<std::string>>> found;
  for (std::size_t at = part.find("<table>"); at != part.npos; at = part.find("<table>", at + 1)) {
    auto& table = found.emplace_back();
    const std::string text = part.substr(at, part.find("</table>", at) - at);
    for (const std::string& line : lines_of(text)) {
      if (!line.starts_with("<tr><td>")) continue;
      auto& row = table.emplace_back();
      const std::regex field("<td>([^<]*)</td>");
      for (std::sregex_iterator i(line.begin(), line.end(), field), end; i != end; ++i) row.push_back((*i)[1]);
    }
  }
  return found;
}

TEST_F(PaperReport, IsFilledAndTheSameAgain) {
  run({});
  const std::string html = file("report.html");
  const Json manifest = Json::parse(file("manifest.json"));

  // Every section that there is, none empty.
  Service list({CITYLEARN_PAPER, "--list"}, folder_ / "list");
  ASSERT_EQ(list.wait(kLongWait), 0);
  int sections = 0;
  for (const std::string& line : lines_of(list.output())) {
    const std::string section = line.substr(0, line.find(' ')), text = part(html, section);
    ++sections;
    EXPECT_GT(occurrences(text, "<p>"), 0) << section;
    ASSERT_FALSE(tables(text).empty()) << section;
    for (const auto& table : tables(text)) {
      EXPECT_FALSE(table.empty()) << section << " has a table without rows";
      for (const auto& row : table)
        EXPECT_TRUE(
            std::any_of(row.begin() + 1, row.end(), [](const auto& field) { return field != "-" && field != ""; }))
            << section << ": nothing is known of " << row.front();
    }
    EXPECT_GT(occurrences(text, "<img "), 0) << section;
  }
  EXPECT_GE(sections, 6);
  EXPECT_EQ(occurrences(html, "<h2 "), sections);
  // Trained for a moment, agents are worse than all that they are compared with.
  for (const char* remark : {"1 of 1 seeds did not reach SPL 0.95", "Worse than the paper: features",
                             "Lower SPL than blind, which never looks", "no better than a policy that never looks",
                             "Not tried: 512, 2048, 4096 features. hog_vlad has"})
    EXPECT_TRUE(contains(html, remark)) << remark;

  // Files: those that the manifest names, each chart with its numbers and as PNG.
  int charts = 0;
  for (const auto& [name, hash] : manifest["files"].items()) {
    const std::string bytes = file(name);
    EXPECT_EQ(sha256(bytes), hash.get<std::string>()) << name;
    const std::string stem = name.substr(0, name.rfind('.'));
    if (name.ends_with(".svg")) {
      ++charts;
      EXPECT_TRUE(contains(bytes, "<path ")) << name;
      EXPECT_TRUE(bytes.ends_with("</svg>\n")) << name;
      EXPECT_TRUE(manifest["files"].contains(stem + ".png")) << name;
      EXPECT_TRUE(manifest["files"].contains(stem + "-lines.csv") || manifest["files"].contains(stem + "-bars.csv"))
          << name;
    } else if (name.ends_with(".png")) {
      EXPECT_TRUE(bytes.starts_with("\x89PNG")) << name;
      EXPECT_TRUE(manifest["files"].contains(stem + ".svg")) << name;
    } else if (name.ends_with(".csv")) {
      EXPECT_EQ(occurrences(bytes, "nan"), 0) << name;
      EXPECT_GE(lines_of(bytes).size(), 1u) << name;
    }
  }
  EXPECT_GT(charts, 10);
  EXPECT_EQ(occurrences(html, "src=\"data:image/svg+xml"), charts);
  EXPECT_EQ(occurrences(html, "src=\""), charts) << "the report needs other files";

  // How it was made.
  EXPECT_EQ(manifest["seeds"], Json::array({1}));
  EXPECT_EQ(manifest["data"][0]["traversals"]["night"]["frames"], 160);
  EXPECT_EQ(manifest["work"].size(), outcomes().size());
  for (const Json& unit : manifest["work"]) EXPECT_TRUE(unit["seconds"].is_number()) << unit;
  const std::string results = file("results.json");
  EXPECT_EQ(Json::parse(results).size(), outcomes().size());
  EXPECT_EQ(occurrences(results, "seconds\""), 0);

  // Once more: no work, the same report to the byte.
  const std::string again = run({});
  const std::string all = std::to_string(outcomes().size());
  EXPECT_TRUE(contains(again, all + " of " + all + " pieces of work are there"));
  EXPECT_FALSE(contains(again, "[1 of "));
  EXPECT_EQ(Json::parse(file("manifest.json"))["files"], manifest["files"]);

  // From nothing, in another folder: the same outcomes.
  run({"--only", "longer-routes"}, 0, "other");
  const std::vector<std::string> known = lines_of(results);
  for (std::string line : lines_of(file("results.json", "other"))) {
    line = std::regex_replace(line, std::regex("^\\[|[\\],]+$"), "");
    EXPECT_TRUE(std::any_of(known.begin(), known.end(), [&](const auto& one) { return one.find(line) != one.npos; }))
        << line.substr(0, 200);
  }
}

TEST_F(PaperReport, GoesOnWhereItWasStopped) {
  const std::vector<std::string> part = {"--only", "longer-routes"};
  {
    Service program(command(part), folder_ / "log");
    ASSERT_TRUE(poll_until([&] { return !outcomes().empty(); }, kLongWait)) << program.output();
    EXPECT_EQ(program.end(SIGINT, seconds(30)), 130);
    EXPECT_TRUE(contains(program.output(), "the same command goes on from here"));
  }
  EXPECT_FALSE(fs::exists(folder_ / "report/report.html"));
  const std::vector<fs::path> before = outcomes();
  std::map<fs::path, fs::file_time_type> times;
  for (const fs::path& path : before) {
    EXPECT_FALSE(Json::parse(contents(path))["outcome"].is_null());
    times[path] = fs::last_write_time(path);
  }
  const std::string rest = run(part);
  EXPECT_TRUE(
      contains(rest, std::to_string(before.size()) + " of " + std::to_string(outcomes().size()) + " pieces of work"));
  EXPECT_GT(outcomes().size(), before.size());
  for (const auto& [path, time] : times) EXPECT_EQ(fs::last_write_time(path), time);
  EXPECT_TRUE(fs::exists(folder_ / "report/report.html"));
}

TEST_F(PaperReport, WrongInputIsOneLine) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{"--dataset", "nordland"}, "--synthetic-frames"},
      {{"--dataset", "moon"}, "moon"},
      {{"--train", "spring"}, "spring"},
      {{"--encoder", "oracle"}, "oracle"},
      {{"--only", "figure-99"}, "figure-99"},
      {{"--seeds", "many"}, "many"},
      {{"--effort", "2"}, "effort"},
      {{"--output", "/dev/null/report"}, "/dev/null/report"}};
  std::vector<std::pair<std::vector<std::string>, std::string>> commands = {
      {{CITYLEARN_PAPER, "--dataset", "plain", "--data", folder_ / "nothing", "--output", folder_ / "report"},
       "nothing"}};
  for (const auto& [arguments, word] : wrong) commands.push_back({command(arguments), word});
  for (const auto& [line, word] : commands) {
    Service program(line, folder_ / "log");
    const auto status = program.wait(kLongWait);
    EXPECT_TRUE(status == 1 || status == 2) << word;
    EXPECT_EQ(lines_of(program.output()).size(), 1u) << program.output();
    EXPECT_TRUE(contains(program.output(), word));
    EXPECT_FALSE(fs::exists(folder_ / "report/report.html"));
  }
}

}  // namespace
}  // namespace citylearn::testing
