// SPDX-License-Identifier: Apache-2.0
// The pages docs/tutorials/write-a-*.md, followed to the letter, their promises kept.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
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

/// Follows a page of docs/tutorials to the letter: its files are written into a folder of their own, its commands run.
class Tutorial : public ::testing::Test {
 protected:
  /// `page` is the name of its file, without ".md".
  explicit Tutorial(const std::string& page)
      : page_(contents(CITYLEARN_SOURCE_DIR "/docs/tutorials/" + page + ".md")), workplace_(folder_ / "workplace") {}

  /// Writes all files and runs all commands; fails unless each succeeds and there are so many files.
  void follow(int files);
  /// Returns the number of which the page says "SAID at least NUMBER", whatever its line breaks; fails when it does
  /// not.
  double promised(const std::string& said) const;
  /// Expects the SPL that the page promises in the summary.json of runs/first: on the traversal `trained` ("an SPL of")
  /// and on `other` (`other_said`), where the blind control has less. Returns the summary.
  nlohmann::json expect_promised_spl(const std::string& trained, const std::string& other,
                                     const std::string& other_said) const;
  /// Expects that the page's last step copies `file` into `folder`, that this is where plug-ins such as `neighbour`
  /// are, and that `cmake` (a CMakeLists.txt) takes it from there by the pattern `glob`.
  void expect_home(const std::string& file, const std::string& folder, const std::string& neighbour,
                   const std::string& cmake, const std::string& glob) const;

  const std::string page_;
  const Folder folder_;
  const std::string workplace_;  ///< the reader's folder
  std::string output_;           ///< what the commands printed
};

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

class LearnerTutorial : public Tutorial {
 protected:
  LearnerTutorial() : Tutorial("write-a-learner") {}
};

TEST_F(LearnerTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] LearnerContract.GoesOnFromWhatItSavedBitForBit/a2c"));
  for (const char* parameter : {"learning-rate", "gamma", "lambda", "entropy", "value-weight"})
    EXPECT_TRUE(contains(output_, "--a2c-" + std::string(parameter)));
  EXPECT_TRUE(contains(output_, "| fast"));
  auto summary = expect_promised_spl("summer", "fall", "on summer and of");
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

TEST_F(LearnerTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("a2c.cc", "policy_service/learning/learners/", "ppo.cc", "policy_service/CMakeLists.txt",
              "learning/*/*.cc");
}

class DatasetTutorial : public Tutorial {
 protected:
  DatasetTutorial() : Tutorial("write-a-dataset") {}
};

TEST_F(DatasetTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(3));
  EXPECT_TRUE(contains(output_, "[       OK ] All/DatasetsOfFiles.KnowAFolderOfOtherThingsIsNotTheirs/photo_log"));
  EXPECT_TRUE(contains(output_, "wall: recognised as photo_log"));
  EXPECT_TRUE(contains(output_, "photo_log: 135 frames, 0 bad"));
  EXPECT_TRUE(contains(output_, "evening    evening        75      59    0.80"));
  EXPECT_TRUE(contains(output_, "morning    morning        60      59    1.00"));
  expect_promised_spl("morning", "evening", "in the morning and of");
}

TEST_F(DatasetTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("photo_log.cc", "env_service/datasets/", "plain.cc", "env_service/CMakeLists.txt",
              "GLOB_RECURSE sources");
}

class EncoderTutorial : public Tutorial {
 protected:
  EncoderTutorial() : Tutorial("write-an-encoder") {}

  /// Recall@1 in a run of vpr.
  double recall(const std::string& run, const std::string& encoder, const std::string& query) const {
    const auto results = nlohmann::json::parse(contents(workplace_ + "/runs/" + run + "/results.json"));
    for (const auto& row : results.at("rows"))
      if (row.at("encoder") == encoder && row.at("query") == query) return row.at("recall_1").get<double>();
    ADD_FAILURE() << "no row for " << encoder << " and " << query;
    return 0;
  }
};

TEST_F(EncoderTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] Encoders/EncoderContract.AnyPictureGivesFiniteNumbers/patch_means"));
  for (const char* parameter : {"across", "down"})
    EXPECT_TRUE(contains(output_, "--patch_means-" + std::string(parameter)));
  EXPECT_GE(recall("coarse", "patch_means", "fall"), promised("it recognises"));
  EXPECT_GE(recall("coarse", "patch_means", "winter"), promised("in fall and"));
  EXPECT_GE(recall("fine", "patch_means", "winter"), promised("patches recognise"));
  EXPECT_GE(recall("coarse", "hog_vlad", "winter"), promised("patches recognise"));
  expect_promised_spl("summer", "fall", "on summer and of");
}

TEST_F(EncoderTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("patch_means.cc", "encoder_service/encoders/", "raw84.cc", "encoder_service/CMakeLists.txt",
              "GLOB_RECURSE sources");
}

class NetworkTutorial : public Tutorial {
 protected:
  NetworkTutorial() : Tutorial("write-a-network") {}
};

TEST_F(NetworkTutorial, KeepsItsPromises) {
  ASSERT_NO_FATAL_FAILURE(follow(2));
  EXPECT_TRUE(contains(output_, "[       OK ] All/Networks.DifferentiateWhatTheyCompute/gru"));
  for (const char* parameter : {"hidden", "cells"}) EXPECT_TRUE(contains(output_, "--gru-" + std::string(parameter)));
  auto summary = expect_promised_spl("summer", "fall", "on summer and of");
  EXPECT_LT(summary["controls"]["shuffled"]["fall"]["spl"].get<double>(),
            summary["controls"]["blind"]["fall"]["spl"].get<double>());
}

TEST_F(NetworkTutorial, TheFolderForThisRepositoryIsRight) {
  expect_home("gru.cc", "policy_service/network/agents/", "features.cc", "policy_service/CMakeLists.txt",
              "network/*/*.cc");
}

}  // namespace
}  // namespace citylearn::testing
