// SPDX-License-Identifier: Apache-2.0
// Who may write to a run's folder, and what of an earlier run may be replaced.
#include "policy_service/records/output_folder.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "policy_service/records/report.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const std::string kRow = "env,1,1,0,summer,0,0,0,1,1,1,1.000000,1\n";

class OutputFolderTest : public ::testing::Test {
 protected:
  OutputFolderTest() { options_.output = folder_ / "out"; }
  std::string path(const std::string& name) const { return options_.output + "/" + name; }
  bool exists(const std::string& name) const { return std::filesystem::exists(path(name)); }
  /// Writes the files of a training.
  void train() {
    for (const char* name : {"manifest.json", "metrics.csv", "summary.json", "checkpoints/checkpoint-7.clk"})
      make_file(path(name), "of a training");
    evaluate();
  }
  /// Writes the files of an evaluation.
  void evaluate() {
    make_file(path("episodes.csv"), std::string(120, 'x') + "\n" + kRow);
    make_file(path("summary.json"), "{}");
  }
  std::string refusal() {
    return error_of([this] { prepare_output(options_); });
  }

  Folder folder_;
  PolicyServiceOptions options_;
};

TEST_F(OutputFolderTest, IsOneProcesssAtATime) {
  const std::string other = folder_ / "other";
  {
    const OutputFolder mine(options_.output);
    EXPECT_EQ(error_of([this] { OutputFolder second(options_.output); }),
              options_.output + ": another policy_service writes here (end it, or choose another --output)");
    EXPECT_NO_THROW(OutputFolder{other});
    EXPECT_NO_THROW(OutputFolder{""}) << "no folder";
  }
  EXPECT_NO_THROW(OutputFolder{options_.output});
}

TEST_F(OutputFolderTest, KeepsAnEarlierRunUnlessToldToReplaceIt) {
  train();
  for (const char* mode : {"train", "evaluate"}) {
    options_.mode = mode;
    EXPECT_TRUE(contains(refusal(), "out/manifest.json: belongs to an earlier run (continue it with --resume, "));
  }
  for (const char* name : {"manifest.json", "metrics.csv", "summary.json"}) {
    std::filesystem::remove(path(name));
    EXPECT_TRUE(contains(refusal(), "belongs to an earlier run")) << "without " << name;
  }
  EXPECT_TRUE(exists("episodes.csv"));
  EXPECT_TRUE(exists("checkpoints/checkpoint-7.clk"));
}

TEST_F(OutputFolderTest, ARunThatNeverBeganIsNoEarlierRun) {
  make_file(path("episodes.csv"),
            "environment,incarnation,episode,agent,traversal,evaluation,task,start,goal,steps,shortest,reward,"
            "completed\n");
  make_file(path("manifest.json.77.tmp"), "half of it");
  EXPECT_EQ(refusal(), "");
  EXPECT_FALSE(exists("manifest.json.77.tmp"));
}

TEST_F(OutputFolderTest, OverwriteReplacesWhatTheRunWrites) {
  train();
  options_.overwrite = true;
  options_.mode = "evaluate";
  EXPECT_EQ(refusal(), "");
  EXPECT_FALSE(exists("summary.json"));
  EXPECT_FALSE(exists("episodes.csv"));
  EXPECT_TRUE(exists("checkpoints/checkpoint-7.clk")) << "it may act from it";
  options_.mode = "train";
  options_.initial_checkpoint = path("checkpoints/../checkpoints/checkpoint-7.clk");
  EXPECT_TRUE(contains(refusal(), "checkpoint-7.clk: would be removed by --overwrite"));
  options_.initial_checkpoint.clear();
  EXPECT_EQ(refusal(), "");
  EXPECT_FALSE(exists("manifest.json"));
  EXPECT_FALSE(exists("checkpoints/checkpoint-7.clk"));
}

TEST_F(OutputFolderTest, ResumeContinuesARunOfItsKind) {
  options_.resume = true;
  EXPECT_EQ(refusal(), "") << "nothing there: it begins";
  evaluate();
  EXPECT_TRUE(contains(refusal(), "belongs to an evaluation"));
  options_.mode = "evaluate";
  EXPECT_EQ(refusal(), "");
  train();
  EXPECT_TRUE(contains(refusal(), "belongs to a training"));
  options_.mode = "train";
  EXPECT_EQ(refusal(), "");
}

TEST_F(OutputFolderTest, AResumedRunKeepsItsIdAndACopyGetsItsOwn) {
  options_.node.id = "policy";
  std::filesystem::create_directories(options_.output);
  const std::uint64_t first = run_id_for(options_);
  options_.resume = true;
  EXPECT_GE(run_id_for(options_), first) << "there is no manifest";
  make_file(path("manifest.json"), manifest_json(options_, {}, {}, "", first).dump());
  EXPECT_EQ(run_id_for(options_), first);
  options_.node.id = "another";
  EXPECT_NE(run_id_for(options_), first);
  options_.node.id = "policy";
  const std::string original = options_.output;
  options_.output = folder_ / "copy";
  std::filesystem::copy(original, options_.output, std::filesystem::copy_options::recursive);
  const std::uint64_t second = run_id_for(options_);
  EXPECT_NE(second, first);
  make_file(path("manifest.json"), manifest_json(options_, {}, {}, "", second).dump());
  EXPECT_EQ(run_id_for(options_), second) << "once it has written its own";
  std::filesystem::remove_all(original);
  std::filesystem::rename(options_.output, original);
  options_.output = original;
  EXPECT_EQ(run_id_for(options_), second) << "moved, it is the same";
  make_file(path("manifest.json"), "{\"job\": 1234}");
  EXPECT_EQ(run_id_for(options_), 1234U) << "of an earlier version";
  make_file(path("manifest.json"), "{\"jo");
  EXPECT_GE(run_id_for(options_), second);
}

}  // namespace
}  // namespace citylearn::testing
