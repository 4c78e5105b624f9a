// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/reduced_traversal.h"

#include <spdlog/spdlog.h>

#include <filesystem>
#include <numeric>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {
namespace {

std::string text_of(const Reduction& reduction, const TraversalWork& work) {
  const Bytes bytes = reduction.save(work.key().encoder);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Returns the reduction in a file; null when there is none, or a damaged one.
std::shared_ptr<const Reduction> load(const std::string& path, const std::string& encoder) {
  if (path.empty() || !std::filesystem::exists(path)) return nullptr;
  const std::string bytes = read_file(path);
  try {
    return std::make_shared<Reduction>(Reduction::load(std::as_bytes(std::span(bytes)), encoder, path));
  } catch (const Error& error) {
    spdlog::warn("{}; learning it anew", error.what());
    return nullptr;
  }
}

/// Returns where features stay: under the digest of all that decides them beside the descriptors. Null where they do
/// not: a bad frame, which has its neighbour's, may be mended.
std::unique_ptr<FeatureStore> store_of(const ReducedTraversal& reduced, const TraversalWork& work,
                                       const std::string& folder) {
  const FeatureStore::Key& key = work.key();
  const int dimension = reduced.reduction->dimension();
  if (folder.empty() || dimension >= key.dimension || !work.bad().empty()) return nullptr;
  const std::string name = "features " + sha256(text_of(*reduced.reduction, work));
  return std::make_unique<FeatureStore>(folder, FeatureStore::Key{name, dimension, key.traversal, key.frames});
}

std::span<float> numbers_of(Eigen::MatrixXf& features, int frame) {
  return {features.col(frame).data(), static_cast<std::size_t>(features.rows())};
}

}  // namespace

ReducedTraversal reduce_traversal(const TraversalWork& work, const ReductionSource& source, const std::string& store) {
  const FeatureStore::Key& key = work.key();
  ReducedTraversal result;
  result.reduction = source.known ? source.known : load(source.path, key.encoder);
  if (!result.reduction) {
    const std::vector<int> sample = training_frames(Reduction::kMaxSample, key.frames);
    Eigen::MatrixXf descriptors(key.dimension, static_cast<Eigen::Index>(sample.size()));
    work.read(sample, descriptors, result.lost);
    if (!result.lost.empty()) return result;
    result.reduction = std::make_shared<Reduction>(Reduction::learn(std::move(descriptors), source.options));
    if (!source.path.empty()) {
      write_file(source.path, text_of(*result.reduction, work));
      spdlog::info("stored the reduction in {}", source.path);
    }
  }
  result.reduction->check_input(key.dimension);
  result.features.resize(result.reduction->dimension(), key.frames);
  std::unique_ptr<FeatureStore> kept;
  int there = 0;
  try {
    kept = store_of(result, work, store);
    while (kept && there < key.frames && kept->read(there, numbers_of(result.features, there))) ++there;
  } catch (const Error& error) {
    spdlog::warn("{}; features are made anew", error.what());
    kept = nullptr;
  }
  if (there == key.frames) return result;
  result.features = result.reduction->apply(key.frames, [&](Eigen::Index first, Eigen::Ref<Eigen::MatrixXf> block) {
    std::vector<int> frames(static_cast<std::size_t>(block.cols()));
    std::iota(frames.begin(), frames.end(), static_cast<int>(first));
    work.read(frames, block, result.lost);
  });
  try {
    for (int frame = 0; kept && result.lost.empty() && frame < key.frames; ++frame)
      kept->write(frame, numbers_of(result.features, frame));
  } catch (const Error& error) {
    spdlog::warn("{}; the next start makes the features again", error.what());
  }
  return result;
}

}  // namespace citylearn
