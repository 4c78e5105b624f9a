// SPDX-License-Identifier: Apache-2.0
// libFuzzer's entry; CITYLEARN_FUZZ_TARGET is the function to run.
#include <spdlog/spdlog.h>

#include <cstdint>

#include "tests/fuzz/targets.h"

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  spdlog::set_level(spdlog::level::off);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  citylearn::fuzz::CITYLEARN_FUZZ_TARGET(std::as_bytes(std::span(data, size)));
  return 0;
}
