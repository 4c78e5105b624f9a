// SPDX-License-Identifier: Apache-2.0
// docs/tutorials/write-a-learner.md, followed to the letter: its files are written, its commands run, its promises
// kept.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <vector>

#include "tests/paths.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

struct Block {
  std::string language, file, text;
};

/// Fenced code blocks, "```language file".
std::vector<Block> blocks_of(const std::string& markdown) {
  std::vector<Block> blocks;
  std::istringstream lines(markdown);
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.rfind("```", 0) == 0) {
      inside = !inside;
      if (!inside) continue;
      std::istringstream words(line.substr(3));
      Block& block = blocks.emplace_back();
      words >> block.language >> block.file;
    } else if (inside) {
      blocks.back().text += line + "\n";
    }
  }
  EXPECT_FALSE(inside) << "a block without an end";
  return blocks;
}

class Tutorial : public ::testing::Test {
 protected:
  const std::string page_ = contents(CITYLEARN_SOURCE_DIR "/docs/tutorials/write-a-learner.md");
  const std::vector<Block> blocks_ = blocks_of(page_);
};

TEST_F(Tutorial, KeepsItsPromises) {
  Folder folder;
  // The page says build/release; this build may be another one.
  fs::create_directories(folder / "citylearn/build");
  fs::create_directory_symlink(CITYLEARN_BINARY_DIR, folder / "citylearn/build/release");
  fs::create_directories(folder / "my_learner");
  std::string script = "set -euo pipefail\ntrap 'kill $(jobs -p) 2>/dev/null || true' EXIT\n";
  script += "cd '" + (folder / "my_learner") + "'\nexport CITYLEARN='" + (folder / "citylearn") + "'\n";
  // Our own warnings too: the page ends with the file in this repository.
  script += "export CXX='" CITYLEARN_CXX "' CXXFLAGS='" CITYLEARN_CXX_FLAGS "'\n";
  script += "export PATH=\"$(dirname '" CITYLEARN_CMAKE "'):$PATH\"\n";
  script += "export CITYLEARN_SESSION=tutorial CITYLEARN_DOMAIN=" + std::to_string(own_domain()) + "\n";
  int commands = 0, files = 0;
  for (const Block& block : blocks_) {
    if (block.language == "sh") {
      script += block.text;
      ++commands;
    } else if (!block.file.empty()) {
      std::ofstream(folder / ("my_learner/" + block.file)) << block.text;
      ++files;
    }
  }
  ASSERT_EQ(files, 2);
  ASSERT_GE(commands, 5);
  script += "echo followed to the end\n";
  std::ofstream(folder / "tutorial.sh") << script;
  Service reader({"/bin/bash", folder / "tutorial.sh"}, folder / "log");
  const auto status = reader.wait(seconds(400));
  if (!status) {  // its env_services shall not outlive it
    reader.send(SIGTERM);
    reader.wait(seconds(90));
  }
  const std::string said = reader.output();
  ASSERT_TRUE(status.has_value()) << said;
  ASSERT_TRUE(contains(said, "followed to the end"));
  // What the page says of what is to be seen.
  EXPECT_TRUE(contains(said, "[       OK ] LearnerContract.GoesOnFromWhatItSavedBitForBit/a2c"));
  EXPECT_FALSE(contains(said, "[  FAILED  ]"));
  for (const char* parameter : {"learning-rate", "gamma", "lambda", "entropy", "value-weight"})
    EXPECT_TRUE(contains(said, "--a2c-" + std::string(parameter)));
  EXPECT_TRUE(contains(said, "| fast"));
  std::smatch promised;
  const std::regex promise(
      R"(an\s+SPL\s+of\s+at\s+least\s+([0-9.]+)\s+on\s+summer\s+and\s+of\s+at\s+least\s+([0-9.]+)\s+on\s+fall)");
  ASSERT_TRUE(std::regex_search(page_, promised, promise)) << "the page promises nothing";
  const Json summary = Json::parse(contents(folder / "my_learner/runs/first/summary.json"));
  EXPECT_GE(summary["evaluate"]["summer"]["spl"].get<double>(), std::stod(promised[1]));
  EXPECT_GE(summary["evaluate"]["fall"]["spl"].get<double>(), std::stod(promised[2]));
  EXPECT_LT(summary["controls"]["blind"]["fall"]["spl"].get<double>(), std::stod(promised[2]) - 0.02);
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

/// The page's last step: the folder it names is where CMake looks for learners, and has no file of that name yet.
TEST_F(Tutorial, TheFolderForThisRepositoryIsRight) {
  const std::string folder = "policy_service/learning/learners/", root = CITYLEARN_SOURCE_DIR "/";
  EXPECT_TRUE(contains(page_, "cp a2c.cc $CITYLEARN/" + folder));
  EXPECT_TRUE(fs::exists(root + folder + "ppo.cc"));
  EXPECT_FALSE(fs::exists(root + folder + "a2c.cc"));
  EXPECT_TRUE(contains(contents(root + "policy_service/CMakeLists.txt"), "learning/*/*.cc"));
}

}  // namespace
}  // namespace citylearn::testing
