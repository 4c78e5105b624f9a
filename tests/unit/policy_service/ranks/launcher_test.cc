// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/launcher.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <string>

#include "core/util/error.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// The rank and the number of ranks with an environment, and those given.
std::string numbered(const std::map<std::string, std::string>& environment, int rank = -1, int ranks = 0) {
  const std::vector<std::string> all = {"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", "PMI_RANK", "PMI_SIZE",
                                        "SLURM_PROCID",         "SLURM_NTASKS"};
  for (const std::string& name : all) ::unsetenv(name.c_str());
  for (const auto& [name, value] : environment) ::setenv(name.c_str(), value.c_str(), 1);
  PolicyServiceOptions options;
  options.ranks_domain = 7;
  options.rank = rank;
  options.ranks = ranks;
  const std::string problem = error_of([&] { number_ranks(options); });
  for (const std::string& name : all) ::unsetenv(name.c_str());
  return problem.empty() ? std::to_string(options.rank) + " of " + std::to_string(options.ranks) : problem;
}

TEST(Launcher, NumbersRanksWhereOptionsDoNot) {
  const std::map<std::string, std::string> slurm = {{"SLURM_PROCID", "3"}, {"SLURM_NTASKS", "4"}};
  EXPECT_EQ(numbered(slurm), "3 of 4");
  EXPECT_EQ(numbered({{"PMI_RANK", "1"}, {"PMI_SIZE", "2"}}), "1 of 2");
  EXPECT_EQ(numbered({{"OMPI_COMM_WORLD_RANK", "2"}, {"OMPI_COMM_WORLD_SIZE", "3"}}), "2 of 3");
  EXPECT_EQ(numbered(slurm, 0), "0 of 4");
  EXPECT_EQ(numbered(slurm, 1, 8), "1 of 8");
  EXPECT_EQ(numbered({}, 1, 2), "1 of 2");
}

TEST(Launcher, OfMpirunGoesBeforeThatOfTheJob) {
  EXPECT_EQ(
      numbered(
          {{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "1"}, {"OMPI_COMM_WORLD_RANK", "2"}, {"OMPI_COMM_WORLD_SIZE", "3"}}),
      "2 of 3");
}

TEST(Launcher, SaysWhatIsWrong) {
  EXPECT_TRUE(contains(numbered({}), "--rank: is missing"));
  EXPECT_TRUE(contains(numbered({}, 2, 2), "--rank: is 2, must be 0 to 1"));
  EXPECT_TRUE(contains(numbered({{"PMI_RANK", "x"}, {"PMI_SIZE", "2"}}), "PMI_RANK: 'x' is not a number"));
  PolicyServiceOptions secured;
  secured.ranks_domain = 7;
  secured.rank = 0;
  secured.ranks = 2;
  secured.node.middleware.security = "keys";
  EXPECT_TRUE(contains(error_of([&] { number_ranks(secured); }), "--security: does not cover the sums"));
  secured.unprotected_sums = true;
  EXPECT_EQ(error_of([&] { number_ranks(secured); }), "");
}

}  // namespace
}  // namespace citylearn::testing
