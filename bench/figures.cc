// SPDX-License-Identifier: Apache-2.0
#include "bench/figures.h"

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/util/error.h"

namespace citylearn::bench {

void record_figure(const Figure& figure) {
  const char* path = std::getenv("CITYLEARN_BENCH_FIGURES");
  if (!path) return;
  const nlohmann::json line = {{"name", figure.name},
                               {"value", figure.value},
                               {"unit", figure.unit},
                               {"better", figure.better == Better::kLower ? "lower" : "higher"}};
  std::ofstream out(path, std::ios::app);
  out << line.dump() << '\n' << std::flush;
  if (!out) throw Error("cannot be written", path);
}

}  // namespace citylearn::bench
