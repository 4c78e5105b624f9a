// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "policy_service/network/trained_agent.h"

namespace citylearn {

/// A safetensors file (https://github.com/huggingface/safetensors): 8 bytes (little-endian) with the length of a JSON
/// header, the header, the numbers. Here all of them are 32-bit floats.
struct Safetensors {
  struct Tensor {
    std::vector<std::uint64_t> shape;
    std::vector<float> numbers;  ///< row-major: the last side runs fastest
  };
  std::map<std::string, std::string> metadata;
  std::map<std::string, Tensor> tensors;

  /// The same contents give the same bytes.
  std::string bytes() const;
  /// Throws Error naming `where` and the tensor: header, types, shapes that don't fit their bytes, overlaps, holes.
  static Safetensors parse(std::string_view bytes, const std::string& where);
};

/// The agent's parameters under the names of the network's tensors, each rows x cols; and, where the network was built
/// around a route, its features as `reference`, N x D. `metadata` goes along with what the agent is.
Safetensors parameters_of(const TrainedAgent& agent, const std::map<std::string, std::string>& metadata);

/// Puts the file's parameters in the place of the agent's. A vector of n may be of shape [n] or [n, 1]; `reference` is
/// not looked at. Throws Error naming the file and the tensor that is missing, unknown, of another shape or not finite,
/// or the other network it was made for; the agent is then as before.
void load_parameters(const std::string& path, TrainedAgent& agent);

}  // namespace citylearn
