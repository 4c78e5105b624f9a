// SPDX-License-Identifier: Apache-2.0
// What a person says on the command line becomes a Source.
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>

#include "env_service/dataset_io/selection.h"
#include "tests/support/data/pictures.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// The source that `line` says; throws CLI::ParseError.
Source parsed(const std::string& line) {
  Source source;
  CLI::App app;
  add_dataset_options(app, source, "Dataset");
  add_selection_options(app, source.selection, "Part");
  app.parse(line);
  return source;
}

TEST(Options, Ranges) {
  const Selection all = parsed("").selection;
  EXPECT_EQ(all.first, 0);
  EXPECT_EQ(all.end, std::numeric_limits<int>::max());
  EXPECT_EQ(all.step, 1);
  EXPECT_EQ(all.step_metres, 0);
  EXPECT_FALSE(all.skip_bad_frames);
  const Selection part = parsed("--frames 10:200 --metres 5.5: --step 3 --on-bad-frame skip").selection;
  EXPECT_EQ(part.first, 10);
  EXPECT_EQ(part.end, 200);
  EXPECT_EQ(part.from, 5.5);
  EXPECT_EQ(part.to, std::numeric_limits<double>::infinity());
  EXPECT_EQ(part.step, 3);
  EXPECT_TRUE(part.skip_bad_frames);
  EXPECT_EQ(parsed("--frames :7").selection.end, 7);
  EXPECT_EQ(parsed("--frames 7:").selection.first, 7);
  EXPECT_EQ(parsed("--metres :70").selection.to, 70);
  for (const std::string wrong :
       {"--frames 7", "--frames :", "--frames 5:5", "--frames 5:4", "--frames=-2:4", "--frames a:4", "--frames 1:2:3",
        "--frames 1.5:3", "--metres 5:5", "--metres nan:3", "--metres x:", "--step 0", "--step-metres 0.04",
        "--step 2 --step-metres 1", "--align-by luck", "--align-within 0", "--on-bad-frame ignore",
        "--frames 1:99999999999"})
    EXPECT_THROW(parsed(wrong), CLI::ParseError) << wrong;
}

TEST(Options, Alignment) {
  const Selection aligned = parsed("--align-to summer --align-by gps --align-within 12.5 --step-metres 2").selection;
  EXPECT_EQ(aligned.align, "summer");
  EXPECT_EQ(aligned.by, "gps");
  EXPECT_EQ(aligned.tolerance, 12.5);
  EXPECT_EQ(aligned.step_metres, 2);
}

TEST(Options, Rule) {
  EXPECT_FALSE(parsed("").rule);
  EXPECT_EQ(parsed("--rule street-fixed").rule, StateRule::kStreetFixed);
  EXPECT_THROW(parsed("--rule road"), CLI::ParseError);
}

TEST(Options, OpenTheDataset) {
  const auto dataset = open_dataset(parsed("--dataset synthetic --synthetic-frames 40"));
  EXPECT_EQ(dataset->load(dataset->names().front()).frames, 40);
  EXPECT_EQ(error_of([] { open_dataset(parsed("--dataset plain --data x --synthetic-frames 40")); }),
            "--synthetic-frames: is for dataset synthetic, but the dataset is plain");
  EXPECT_NE(error_of([] { open_dataset(parsed("--dataset none")); }).find("unknown dataset 'none'"), std::string::npos);
}

}  // namespace
}  // namespace citylearn::testing
