// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/parameter_chunks.h"

#include <openssl/sha.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace citylearn {
namespace {

std::uint64_t hash_of(const float* values, std::size_t count) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(values), count * sizeof(float), digest);
  std::uint64_t number = 0;
  for (int i = 0; i < 8; ++i) number = number << 8 | digest[i];
  return number;
}

std::size_t chunks_of(std::size_t bytes) {
  return std::max<std::size_t>(1, (bytes + msg::MAX_CHUNK - 1) / msg::MAX_CHUNK);
}

/// Bytes of chunk `index`, of so many in all.
std::size_t size_of(std::size_t index, std::size_t bytes) {
  return std::min<std::size_t>(msg::MAX_CHUNK, bytes - index * msg::MAX_CHUNK);
}

/// Whether all the floats of a chunk are. None lies in two chunks.
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

std::uint32_t ParameterChunks::chunks() const { return static_cast<std::uint32_t>(chunks_of(total_bytes())); }

void ParameterChunks::fill(std::uint32_t chunk, msg::PolicyParameters& message) const {
  message.version() = version_;
  message.total_bytes() = total_bytes();
  message.hash() = hash_;
  message.chunk() = chunk;
  message.chunks() = chunks();
  message.data().resize(size_of(chunk, total_bytes()));
  std::memcpy(message.data().data(),
              reinterpret_cast<const unsigned char*>(values_.data()) + std::size_t{chunk} * msg::MAX_CHUNK,
              message.data().size());
}

bool ParameterAssembly::expect(std::uint64_t version, std::uint64_t total_bytes, std::uint64_t hash,
                               std::uint32_t chunks) {
  if (total_bytes != static_cast<std::uint64_t>(parameters_) * sizeof(float) || chunks != chunks_of(total_bytes))
    return false;
  if ((newest_ && version <= newest_->version) || parts_.contains(version)) return true;
  if (parts_.size() == 2) {
    if (version < parts_.rbegin()->first) return true;
    parts_.erase(std::prev(parts_.end()));
  }
  parts_[version] = {hash, std::vector<bool>(chunks, false), chunks, Vector<float>(parameters_)};
  return true;
}

bool ParameterAssembly::take(const msg::PolicyParameters& chunk) {
  if (!expect(chunk.version(), chunk.total_bytes(), chunk.hash(), chunk.chunks())) return false;
  auto found = parts_.find(chunk.version());
  if (found == parts_.end()) {
    if (chunk.chunks() > 1 || (newest_ && chunk.version() <= newest_->version)) return true;
    // Whole in this one chunk: of use, however many newer ones have been announced meanwhile.
    found = parts_.emplace(chunk.version(), Part{chunk.hash(), {false}, 1, Vector<float>(parameters_)}).first;
  }
  Part& part = found->second;
  if (chunk.hash() != part.hash || chunk.data().size() != size_of(chunk.chunk(), chunk.total_bytes())) return false;
  if (part.has[chunk.chunk()]) return true;
  if (!finite(chunk.data())) return false;
  std::memcpy(reinterpret_cast<unsigned char*>(part.values.data()) + std::size_t{chunk.chunk()} * msg::MAX_CHUNK,
              chunk.data().data(), chunk.data().size());
  part.has[chunk.chunk()] = true;
  if (--part.left > 0) return true;
  const bool right = hash_of(part.values.data(), static_cast<std::size_t>(part.values.size())) == part.hash;
  if (right)
    newest_ = std::make_shared<VersionedParameters>(VersionedParameters{chunk.version(), std::move(part.values)});
  // An older one is of no use any more; a wrong one is asked for again.
  parts_.erase(right ? parts_.begin() : found, std::next(found));
  return right;
}

std::optional<ParameterAssembly::Missing> ParameterAssembly::missing() const {
  if (parts_.empty()) return std::nullopt;
  const auto& [version, part] = *parts_.begin();
  Missing missing{version, {}};
  for (std::uint32_t chunk = 0; chunk < part.has.size() && missing.chunks.size() < msg::MAX_PARTS_ASKED; ++chunk)
    if (!part.has[chunk]) missing.chunks.push_back(chunk);
  return missing;
}

void ParameterAssembly::give_up() {
  if (!parts_.empty()) parts_.erase(parts_.begin());
}

}  // namespace citylearn
