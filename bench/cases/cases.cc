// SPDX-License-Identifier: Apache-2.0
#include "bench/cases/cases.h"

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

Session::Session(std::string middleware) : middleware_(std::move(middleware)) {
  static int count = 0;
  name_ = "bench-" + std::to_string(getpid()) + "-" + std::to_string(++count);
}

testing::Service& Session::start(testing::Arguments command, const std::string& name) {
  command.insert(command.end(), {"--middleware", middleware_, "--domain", std::to_string(kDomain), "--session", name_});
  services_.push_back(std::make_unique<testing::Service>(command, folder_ / (name + ".log")));
  return *services_.back();
}

}  // namespace citylearn::bench
