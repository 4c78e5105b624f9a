// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <fstream>

#include "env_service/dataset_io/dataset.h"
#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"

namespace citylearn::fuzz {

bool features_csv(Input input) {
  static const testing::Folder folder;
  static const DatasetRegistry::Entry& entry = DatasetRegistry::instance().find("dataset", "plain");
  static const std::unique_ptr<Dataset> dataset =
      entry.create(Parameters("dataset plain", entry.parameters, {}), folder.path());
  {
    std::ofstream file(folder / "x.csv", std::ios::binary);
    file.write(reinterpret_cast<const char*>(input.data()), static_cast<std::streamsize>(input.size()));
  }
  return accepted([] {
    const Traversal traversal = dataset->load("x");
    require(traversal.frames >= 2 && traversal.dimension >= 1 && traversal.dimension <= kMaxDimension, "shape");
    require(traversal.features.size() == std::size_t(traversal.frames) * std::size_t(traversal.dimension), "size");
    require(std::all_of(traversal.features.begin(), traversal.features.end(), [](float x) { return std::isfinite(x); }),
            "finite");
    require(traversal.positions.size() == std::size_t(traversal.frames), "positions");
  });
}

}  // namespace citylearn::fuzz
