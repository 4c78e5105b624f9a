// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// Throws Error that names `where`, the operator, the node and what to do when OpenCV's importer (seen in 4.6, so
/// refused with all versions) is known to compute a node otherwise than the ONNX standard defines, without a word, or
/// to crash on it. `model`: an ONNX model. `input`: sides of its picture. `layer`: as OpenCV names it; nodes that it
/// does not depend on are left out. Empty: no number is wanted yet, and only nodes that crash the importer count.
void refuse_misread_nodes(std::span<const std::byte> model, const std::vector<std::int64_t>& input,
                          const std::string& layer, const std::string& where);

}  // namespace citylearn
