// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/launcher.h"

#include <array>
#include <charconv>
#include <cstdlib>
#include <string_view>

#include "core/util/error.h"

namespace citylearn {
namespace {

struct Launcher {
  const char *rank, *ranks;
};
constexpr std::array<Launcher, 3> kLaunchers = {
    {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"}, {"PMI_RANK", "PMI_SIZE"}, {"SLURM_PROCID", "SLURM_NTASKS"}}};

int number_in(const char* variable) {
  const char* const value = std::getenv(variable);
  const std::string_view text = value ? value : "";
  int number = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || problem != std::errc() || end != text.data() + text.size() || number < 0)
    throw Error("'" + std::string(text) + "' is not a number", variable, "give --rank and --ranks");
  return number;
}

}  // namespace

void number_ranks(PolicyServiceOptions& options) {
  if (!options.ranks_domain) {
    if (options.rank > 0 || options.ranks > 1)
      throw Error("needs --ranks-domain", options.ranks > 1 ? "--ranks" : "--rank", "say in which domain they meet");
    options.rank = 0;
    return;
  }
  if (options.mode != "train" || options.role == "actor")
    throw Error("is for what learns, not for " + (options.mode != "train" ? "--mode " + options.mode : "--role actor"),
                "--ranks-domain");
  if (!options.node.middleware.security.empty() && !options.unprotected_sums)
    throw Error("does not cover the sums of ranks, which cross the network in the clear", "--security",
                "give --unprotected-sums where you trust the network");
  for (const Launcher& launcher : kLaunchers) {
    if (options.rank >= 0 && options.ranks > 0) break;
    if (!std::getenv(launcher.rank)) continue;
    if (options.rank < 0) options.rank = number_in(launcher.rank);
    if (options.ranks == 0) options.ranks = number_in(launcher.ranks);
  }
  if (options.rank < 0) throw Error("is missing", "--rank", "a number from 0 to --ranks - 1");
  if (options.ranks < 1) throw Error("is missing", "--ranks", "say how many there are");
  if (options.rank >= options.ranks)
    throw Error("is " + std::to_string(options.rank) + ", must be 0 to " + std::to_string(options.ranks - 1) +
                    " of --ranks " + std::to_string(options.ranks),
                "--rank");
}

}  // namespace citylearn
