// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/help_text.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>

#include "core/wire/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

struct Program {
  Program() {
    app.add_option("--count", count, "How many")->capture_default_str()->check(CLI::Range(1, 9))->envname("COUNT");
    auto* mode = app.add_option("--mode", text, "What to do")->check(CLI::IsMember({"train", "evaluate"}));
    app.add_flag("--fast", fast, "At once")->excludes(mode);
    app.add_option("--meeting", text, "Where")->type_name("HOST:PORT")->group("Later");
    add_parameters(app, "sample", {{"rate", "steps a second, which is a rather long explanation of it", 2, 1, 64}},
                   values);
    add_help(app);
  }
  std::string help(CLI::AppFormatMode mode) const { return app.help("", mode); }

  CLI::App app{"Does something.", "program"};
  std::uint32_t count = 4;
  bool fast = false;
  std::string text;
  std::map<std::string, double> values;
};

TEST(HelpText, ShowsDefaultsAndWhatIsAllowedOnEightyColumns) {
  const std::string text = Program().help(CLI::AppFormatMode::Normal);
  EXPECT_TRUE(contains(text, "  --count INT             How many [4; 1..9] ($COUNT)\n")) << text;
  EXPECT_TRUE(contains(text, "  --fast                  At once (not with --mode)\n")) << text;
  EXPECT_TRUE(contains(text, "\nLater:\n  --meeting HOST:PORT     Where\n")) << text;
  EXPECT_TRUE(contains(text, "--mode ")) << text;
  EXPECT_TRUE(contains(text, "evaluate|train") || contains(text, "train|evaluate")) << text;
}

TEST(HelpText, LeavesParametersOfPluginsToHelpAll) {
  const Program program;
  const std::string brief = program.help(CLI::AppFormatMode::Normal), all = program.help(CLI::AppFormatMode::All);
  EXPECT_FALSE(contains(brief, "--sample-rate")) << brief;
  EXPECT_TRUE(contains(brief, "\n--help-all also explains the parameters of sample.\n")) << brief;
  EXPECT_TRUE(contains(all, "  --sample-rate FLOAT     steps a second, which is a rather long explanation of\n" +
                                std::string(26, ' ') + "it [2; 1..64]\n"))
      << all;
  for (const std::string& line : lines_of(all)) EXPECT_LE(line.size(), 80u) << line;
}

}  // namespace
}  // namespace citylearn::testing
