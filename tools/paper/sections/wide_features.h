// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// Features a frame that the paper compares.
inline const std::vector<int> kPaperDimensions = {64, 512, 2048, 4096};

/// Parts of a representation's name, "ENCODER-D".
std::string encoder_of(const std::string& representation);
int features_of(const std::string& representation);

/// The paper's agent as the other sections compare it: `features` on 64 of them.
const Context::Agent& paper_agent(const Context& context);

/// The same on another representation, with fewer seeds where there are more features, as its training takes longer.
Context::Agent wide_agent(const Context& context, const std::string& representation);

}  // namespace citylearn::paper
