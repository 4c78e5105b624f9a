// SPDX-License-Identifier: Apache-2.0
// The house's floors: includes go downwards only (docs/explanation/architecture.md).
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>
#include <string>
#include <vector>

#include "tests/paths.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kServices = {"env_service", "encoder_service", "policy_service", "dashboard"};

const std::vector<std::string> kProduct = {"core",      "env_service", "encoder_service", "policy_service",
                                           "dashboard", "tools",       "python"};

/// The sub-folders of each part, from the lowest floor to the highest. A file includes its own folder and lower ones.
const std::vector<std::vector<std::string>> kOrders = {
    {"core/util", "core/files", "core/task", "core/dds", "core/command_line", "core/plugin", "core/exchange",
     "core/metrics", "core/wire", "core/ros2", "core/recording"},
    {"env_service/files", "env_service/images", "env_service/geometry", "env_service/streets", "env_service/ros2",
     "env_service/matching", "env_service/traversal", "env_service/dataset_io", "env_service/drawn_city",
     "env_service/datasets", "env_service/live", "env_service"},
    {"encoder_service/encoding", "encoder_service/onnx", "encoder_service/encoders", "encoder_service/pipeline",
     "encoder_service"},
    {"policy_service/network", "policy_service/network/layers", "policy_service/network/belief",
     "policy_service/network/autodiff", "policy_service/network/checkpoint", "policy_service/network/agents",
     "policy_service/rollout", "policy_service/learning", "policy_service/learning/optimization",
     "policy_service/learning/learners", "policy_service/interchange", "policy_service/interchange/exporters",
     "policy_service/env_client", "policy_service/distributed", "policy_service/results", "policy_service/records",
     "policy_service/ranks", "policy_service/run", "policy_service"},
    {"dashboard/store", "dashboard/http", "dashboard/live", "dashboard/api", "dashboard"},
};

constexpr int kMaxLines = 500, kMaxHeaderLines = 120;

struct Include {
  std::string file, line, target;
};

const fs::path kRoot = CITYLEARN_SOURCE_DIR;

std::vector<std::string> sources_below(const std::string& folder) {
  std::vector<std::string> found;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kRoot / folder)) {
    const std::string extension = entry.path().extension(), path = fs::relative(entry.path(), kRoot);
    if (path.find("/node_modules/") != path.npos) continue;
    if (extension == ".h" || extension == ".cc" || extension == ".c" || extension == ".inl") found.push_back(path);
  }
  return found;
}

std::vector<Include> includes_below(const std::string& folder) {
  std::vector<Include> found;
  const std::regex pattern(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  for (const std::string& path : sources_below(folder)) {
    std::smatch match;
    for (const std::string& line : lines_of(contents(kRoot / path)))
      if (std::regex_search(line, match, pattern)) found.push_back({path, line, match[1]});
  }
  return found;
}

TEST(Floors, ServicesKnowCoreAndIdlButNeverEachOther) {
  for (const std::string& service : kServices)
    for (const Include& include : includes_below(service))
      for (const std::string& other : kServices)
        EXPECT_FALSE(other != service && include.target.starts_with(other + "/"))
            << include.file << ": " << include.line;
}

TEST(Floors, CoreKnowsNoService) {
  const std::vector<Include> all = includes_below("core");
  ASSERT_GT(all.size(), 20u) << "the scan found too little to be true";
  for (const Include& include : all)
    for (const std::string& service : kServices)
      EXPECT_FALSE(include.target.starts_with(service + "/")) << include.file << ": " << include.line;
}

TEST(Floors, TheLabKnowsServicesAndTheseKnowNoTool) {
  for (const std::string part : {"core", "env_service", "encoder_service", "policy_service", "dashboard", "tools/lab"})
    for (const Include& include : includes_below(part))
      EXPECT_TRUE(!include.target.starts_with("tools/") || include.target.starts_with(part + "/"))
          << include.file << ": " << include.line;
}

TEST(Floors, SubFoldersIncludeOnlyLowerOnes) {
  for (const std::vector<std::string>& order : kOrders) {
    const auto floor_of = [&](const std::string& path) {
      return std::find(order.begin(), order.end(), fs::path(path).parent_path().string());
    };
    const std::string part = order.front().substr(0, order.front().find('/'));
    for (const std::string& path : sources_below(part))
      EXPECT_TRUE(floor_of(path) != order.end() || path.starts_with("dashboard/web/"))
          << path << ": of an unknown folder";
    for (const Include& include : includes_below(part))
      if (include.target.starts_with(part + "/")) {
        EXPECT_LE(floor_of(include.target), floor_of(include.file)) << include.file << ": " << include.line;
      }
  }
}

TEST(Floors, JsonIsParsedInOnePlace) {
  const std::regex parses(R"([Jj]son::(parse|accept|sax_parse)\()");
  for (const std::string& folder : kProduct)
    for (const std::string& path : sources_below(folder)) {
      const std::string text = contents(kRoot / path);
      EXPECT_TRUE(path == "core/files/json.cc" || !std::regex_search(text, parses))
          << path << ": use parse_json(), which bounds how deep it nests";
    }
}

TEST(Floors, FilesStayShort) {
  for (const std::string& folder : kProduct)
    for (const std::string& path : sources_below(folder)) {
      const int lines = occurrences(contents(kRoot / path), "\n");
      EXPECT_LE(lines, path.ends_with(".h") ? kMaxHeaderLines : kMaxLines) << path;
    }
}

TEST(Floors, VendorHeadersStayInTheirOwnMiddlewareFiles) {
  for (const std::string& folder : kProduct)
    for (const Include& include : includes_below(folder)) {
      if (include.target.starts_with("fastdds/") || include.target.starts_with("fastrtps/")) {
        EXPECT_TRUE(include.file.starts_with("core/dds/middleware_fastdds")) << include.file << ": " << include.line;
      }
      if (include.target.starts_with("dds/") || include.target.starts_with("ddsi/")) {
        EXPECT_TRUE(include.file.starts_with("core/dds/middleware_cyclonedds")) << include.file << ": " << include.line;
      }
      EXPECT_FALSE(include.target.starts_with("fastcdr/")) << include.file << ": " << include.line;
    }
}

TEST(Floors, NumbersInEigenPicturesInDatasetsAndEncoders) {
  for (const std::string folder : {"core", "policy_service"})
    for (const Include& include : includes_below(folder))
      EXPECT_FALSE(include.target.starts_with("opencv2/")) << include.file << ": " << include.line;
}

TEST(Floors, SqliteStaysInTheStoreAndInBags) {
  for (const std::string& folder : kProduct)
    for (const Include& include : includes_below(folder))
      if (include.target.starts_with("sqlite3") || include.target.starts_with("SQLiteCpp/")) {
        EXPECT_TRUE(include.file.starts_with("dashboard/store/") || include.file == "env_service/ros2/bag_file.cc")
            << include.file << ": " << include.line;
      }
}

TEST(Floors, ProtobufStaysInReadersAndWritersOfItsFiles) {
  for (const std::string& folder : kProduct)
    for (const Include& include : includes_below(folder))
      if (include.target.starts_with("google/") || include.target.starts_with("onnx/")) {
        EXPECT_TRUE(include.file == "policy_service/interchange/onnx_graph.cc" ||
                    include.file == "policy_service/interchange/event_log.cc" ||
                    include.file.starts_with("encoder_service/onnx/"))
            << include.file << ": " << include.line;
      }
}

}  // namespace
}  // namespace citylearn::testing
