// SPDX-License-Identifier: Apache-2.0
// The house's floors: includes go downwards only (docs/explanation/architecture.md).
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kServices = {"env_service", "encoder_service", "policy_service", "dashboard"};

struct Include {
  std::string file, line, target;
};

std::vector<Include> includes_below(const std::string& folder) {
  std::vector<Include> found;
  const fs::path root = fs::path(CITYLEARN_SOURCE_DIR);
  if (!fs::exists(root / folder)) return found;
  const std::regex pattern(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(root / folder)) {
    const std::string extension = entry.path().extension();
    if (extension != ".h" && extension != ".cc" && extension != ".c" && extension != ".inl") continue;
    std::ifstream in(entry.path());
    std::string line;
    std::smatch match;
    while (std::getline(in, line))
      if (std::regex_search(line, match, pattern)) found.push_back({fs::relative(entry.path(), root), line, match[1]});
  }
  return found;
}

bool begins(const std::string& text, const std::string& start) { return text.rfind(start, 0) == 0; }

TEST(Floors, ServicesKnowCoreAndIdlButNeverEachOther) {
  for (const std::string& service : kServices)
    for (const Include& include : includes_below(service))
      for (const std::string& other : kServices)
        EXPECT_FALSE(other != service && begins(include.target, other + "/")) << include.file << ": " << include.line;
}

TEST(Floors, CoreKnowsNoService) {
  const std::vector<Include> all = includes_below("core");
  ASSERT_GT(all.size(), 20u) << "the scan found too little to be true";
  for (const Include& include : all)
    for (const std::string& service : kServices)
      EXPECT_FALSE(begins(include.target, service + "/")) << include.file << ": " << include.line;
}

TEST(Floors, VendorHeadersStayInTheirOwnMiddlewareFile) {
  for (const std::string folder : {"core", "env_service", "encoder_service", "policy_service", "dashboard", "tools"})
    for (const Include& include : includes_below(folder)) {
      if (begins(include.target, "fastdds/") || begins(include.target, "fastrtps/")) {
        EXPECT_EQ(include.file, "core/dds/middleware_fastdds.cc") << include.line;
      }
      if (begins(include.target, "dds/") || begins(include.target, "ddsi/")) {
        EXPECT_TRUE(begins(include.file, "core/middleware_cyclonedds")) << include.file << ": " << include.line;
      }
      if (begins(include.target, "fastcdr/")) {
        EXPECT_EQ(include.file, "core/wire/messages.cc") << include.line;
      }
    }
}

TEST(Floors, NumbersInEigenPicturesInDatasetsAndEncoders) {
  for (const std::string folder : {"core", "policy_service"})
    for (const Include& include : includes_below(folder))
      EXPECT_FALSE(begins(include.target, "opencv2/")) << include.file << ": " << include.line;
}

TEST(Floors, SqliteStaysInItsOneFile) {
  for (const std::string folder : {"core", "env_service", "encoder_service", "policy_service", "dashboard", "tools"})
    for (const Include& include : includes_below(folder))
      if (begins(include.target, "sqlite3")) {
        EXPECT_EQ(include.file, "dashboard/store/sqlite.cc") << include.line;
      }
}

TEST(Floors, ProtobufStaysInTheWriterOfModels) {
  for (const std::string folder : {"core", "env_service", "encoder_service", "policy_service", "dashboard", "tools"})
    for (const Include& include : includes_below(folder))
      if (begins(include.target, "google/") || begins(include.target, "onnx/")) {
        EXPECT_EQ(include.file, "policy_service/interchange/onnx_graph.cc") << include.line;
      }
}

}  // namespace
