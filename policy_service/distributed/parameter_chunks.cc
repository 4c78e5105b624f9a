// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/parameter_chunks.h"

#include <openssl/sha.h>

#include <cmath>
#include <cstring>
#include <span>

namespace citylearn {
namespace {

std::uint64_t hash_of(const float* values, std::size_t count) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(values), count * sizeof(float), digest);
  std::uint64_t number = 0;
  for (int i = 0; i < 8; ++i) number = number << 8 | digest[i];
  return number;
}

/// Returns whether all floats of a chunk are finite. No float lies in two chunks.
bool finite(const std::vector<std::uint8_t>& bytes) {
  static_assert(msg::MAX_CHUNK % sizeof(float) == 0);
  bool all = true;
  for (std::size_t at = 0; at + sizeof(float) <= bytes.size(); at += sizeof(float)) {
    float number;
    std::memcpy(&number, bytes.data() + at, sizeof number);
    all = all && std::isfinite(number);
  }
  return all;
}

}  // namespace

ParameterChunks::ParameterChunks(std::uint64_t version, const Vector<float>& parameters)
    : version_(version),
      hash_(hash_of(parameters.data(), static_cast<std::size_t>(parameters.size()))),
      values_(parameters.begin(), parameters.end()) {}

std::uint32_t ParameterChunks::chunks() const { return chunk_count(total_bytes()); }

void ParameterChunks::fill(std::uint32_t chunk, msg::PolicyParameters& message) const {
  message.version() = version_;
  message.total_bytes() = total_bytes();
  message.hash() = hash_;
  message.chunk() = chunk;
  message.chunks() = chunks();
  const auto data = chunk_of(std::as_bytes(std::span(values_)), chunk);
  message.data().resize(data.size());
  if (!data.empty()) std::memcpy(message.data().data(), data.data(), data.size());
}

bool ParameterAssembly::expect(std::uint64_t version, std::uint64_t total_bytes, std::uint64_t hash,
                               std::uint32_t chunks) {
  if (total_bytes != static_cast<std::uint64_t>(parameters_) * sizeof(float) || chunks != chunk_count(total_bytes))
    return false;
  if ((newest_ && version <= newest_->version) || parts_.contains(version)) return true;
  if (parts_.size() == 2) {
    if (version < parts_.rbegin()->first) return true;
    parts_.erase(std::prev(parts_.end()));
  }
  parts_.emplace(version, Part{hash, Blob(total_bytes)});
  return true;
}

bool ParameterAssembly::take(const msg::PolicyParameters& chunk) {
  if (!expect(chunk.version(), chunk.total_bytes(), chunk.hash(), chunk.chunks())) return false;
  auto found = parts_.find(chunk.version());
  if (found == parts_.end()) {
    if (chunk.chunks() > 1 || (newest_ && chunk.version() <= newest_->version)) return true;
    // Whole in this one chunk: of use, however many newer ones have been announced meanwhile.
    found = parts_.emplace(chunk.version(), Part{chunk.hash(), Blob(chunk.total_bytes())}).first;
  }
  Part& part = found->second;
  if (chunk.hash() != part.hash) return false;
  if (part.blob.chunks.wants(chunk.chunk()) && !finite(chunk.data())) return false;
  const Taken taken = part.blob.take(chunk.chunk(), chunk.data());
  if (taken == Taken::kDamaged) return false;
  if (taken == Taken::kNotWanted || !part.blob.complete()) return true;
  Vector<float> values(parameters_);
  const Bytes bytes = part.blob.release();
  if (!bytes.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  const bool right = hash_of(values.data(), static_cast<std::size_t>(values.size())) == part.hash;
  if (right) newest_ = std::make_shared<VersionedParameters>(VersionedParameters{chunk.version(), std::move(values)});
  // An older one is of no use any more; a wrong one is asked for again.
  parts_.erase(right ? parts_.begin() : found, std::next(found));
  return right;
}

std::optional<ParameterAssembly::Missing> ParameterAssembly::missing() const {
  if (parts_.empty()) return std::nullopt;
  const auto& [version, part] = *parts_.begin();
  return Missing{version, part.blob.chunks.first_missing(msg::MAX_PARTS_ASKED)};
}

void ParameterAssembly::give_up() {
  if (!parts_.empty()) parts_.erase(parts_.begin());
}

}  // namespace citylearn
