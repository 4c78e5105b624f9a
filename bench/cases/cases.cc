// SPDX-License-Identifier: Apache-2.0
#include "bench/cases/cases.h"

namespace citylearn::bench {

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
