// SPDX-License-Identifier: Apache-2.0
#include "tests/tutorial/tutorial.h"

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

}  // namespace

Tutorial::Tutorial(const std::string& page)
    : page_(contents(CITYLEARN_SOURCE_DIR "/docs/tutorials/" + page + ".md")), workplace_(folder_ / "workplace") {}

void Tutorial::follow(int files) {
  // The page says build/release; this build may be another one.
  fs::create_directories(folder_ / "citylearn/build");
  fs::create_directory_symlink(CITYLEARN_BINARY_DIR, folder_ / "citylearn/build/release");
  fs::create_directories(workplace_);
  std::string script = "set -euo pipefail\ntrap 'kill $(jobs -p) 2>/dev/null || true' EXIT\n";
  script += "cd '" + workplace_ + "'\nexport CITYLEARN='" + (folder_ / "citylearn") + "'\n";
  // Our own warnings too: the page ends with the file in this repository.
  script += "export CXX='" CITYLEARN_CXX "' CXXFLAGS='" CITYLEARN_CXX_FLAGS "'\n";
  script += "export PATH=\"$(dirname '" CITYLEARN_CMAKE "'):$PATH\"\n";
  script += "export CITYLEARN_SESSION=tutorial CITYLEARN_DOMAIN=" + std::to_string(own_domain()) + "\n";
  int commands = 0, written = 0;
  for (const Block& block : blocks_of(page_)) {
    if (block.language == "sh") {
      script += block.text;
      ++commands;
    } else if (!block.file.empty()) {
      std::ofstream(workplace_ + "/" + block.file) << block.text;
      ++written;
    }
  }
  ASSERT_EQ(written, files);
  ASSERT_GE(commands, 4);
  script += "echo followed to the end\n";
  std::ofstream(folder_ / "tutorial.sh") << script;
  Service reader({"/bin/bash", folder_ / "tutorial.sh"}, folder_ / "log");
  const auto status = reader.wait(seconds(400));
  if (!status) {  // its services shall not outlive it
    reader.send(SIGTERM);
    reader.wait(seconds(90));
  }
  output_ = reader.output();
  ASSERT_TRUE(status.has_value()) << output_;
  ASSERT_TRUE(contains(output_, "followed to the end"));
  EXPECT_FALSE(contains(output_, "[  FAILED  ]"));
}

double Tutorial::promised(const std::string& said) const {
  const std::string words = std::regex_replace(said + " at least ", std::regex(" +"), R"(\s+)");
  std::smatch number;
  if (std::regex_search(page_, number, std::regex(words + "([0-9.]*[0-9])"))) return std::stod(number[1]);
  ADD_FAILURE() << "the page does not promise: " << said;
  return 0;
}

nlohmann::json Tutorial::expect_promised_spl(const std::string& trained, const std::string& other,
                                             const std::string& other_said) const {
  auto summary = nlohmann::json::parse(contents(workplace_ + "/runs/first/summary.json"));
  const double least = promised(other_said);
  EXPECT_GE(summary["evaluate"][trained]["spl"].get<double>(), promised("an SPL of"));
  EXPECT_GE(summary["evaluate"][other]["spl"].get<double>(), least);
  EXPECT_LT(summary["controls"]["blind"][other]["spl"].get<double>(), least - 0.02);
  return summary;
}

void Tutorial::expect_home(const std::string& file, const std::string& folder, const std::string& neighbour,
                           const std::string& cmake, const std::string& glob) const {
  const std::string root = CITYLEARN_SOURCE_DIR "/";
  EXPECT_TRUE(contains(page_, "cp " + file + " $CITYLEARN/" + folder));
  EXPECT_TRUE(fs::exists(root + folder + neighbour));
  EXPECT_FALSE(fs::exists(root + folder + file));
  EXPECT_TRUE(contains(contents(root + cmake), glob));
}

}  // namespace citylearn::testing
