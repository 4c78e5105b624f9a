// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/feature_store.h"

#include <zlib.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"

namespace citylearn::fuzz {
namespace {

constexpr int kDimension = 5, kFrames = 9;
constexpr std::size_t kHeader = 512;

bool open_and_use(const std::string& bytes) {
  static const testing::Folder folder;
  static const FeatureStore::Key key{"seed-1 size=8", kDimension, 0x0123456789ABCDEF, kFrames};
  static const std::string path = FeatureStore(folder.path(), key).path();
  std::filesystem::remove(path);
  std::ofstream(path, std::ios::binary) << bytes;
  return accepted([&] {
    FeatureStore store(folder.path(), key);
    require(store.present().size() == kFrames, "present");
    for (int frame = 0; frame < kFrames; ++frame) {
      float there[kDimension], again[kDimension];
      const bool had = store.read(frame, there);
      require(!had || store.present()[std::size_t(frame)], "what is read is present");
      const float wanted[kDimension] = {1, 2, 3, 4, static_cast<float>(frame)};
      store.write(frame, wanted);
      require(store.read(frame, again), "what was written is read");
      require(std::memcmp(again, had ? there : wanted, sizeof again) == 0,  // NOLINT: bit for bit, NaN too
              "the first numbers stay");
      require(store.claim(frame, kFrames - frame) != nullptr, "nobody claims it");
    }
  });
}

}  // namespace

bool feature_store(Input input) {
  std::string bytes(reinterpret_cast<const char*>(input.data()), input.size());
  const bool good = open_and_use(bytes);
  if (bytes.size() < kHeader) return good;
  const auto checksum = static_cast<std::uint32_t>(
      ::crc32_z(0, reinterpret_cast<const unsigned char*>(bytes.data()), kHeader - sizeof(std::uint32_t)));
  std::memcpy(bytes.data() + kHeader - sizeof checksum, &checksum, sizeof checksum);
  open_and_use(bytes);
  return good;
}

}  // namespace citylearn::fuzz
