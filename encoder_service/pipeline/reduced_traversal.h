// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "encoder_service/encoding/reduction.h"
#include "encoder_service/pipeline/traversal_work.h"

namespace citylearn {

/// Where a traversal's reduction comes from.
struct ReductionSource {
  std::shared_ptr<const Reduction> known;  ///< null: it is read from `path`, or learned on this traversal
  ReductionOptions options;                ///< of one that is learned
  std::string path;                        ///< the file that has it, or gets it; empty: none
};

/// A traversal's features, and what made them.
struct ReducedTraversal {
  std::shared_ptr<const Reduction> reduction;
  Eigen::MatrixXf features;  ///< d x F
  std::vector<int> lost;     ///< frames that the store has lost; when there are any, there are no features
};

/// Reduces the descriptors of a traversal that is complete, a block at a time. Features that are fewer numbers than
/// descriptors stay in the `store` (a folder; empty: none), from which the next call takes them without a look at the
/// descriptors. Throws Error. May run on another thread than `work`.
ReducedTraversal reduce_traversal(const TraversalWork& work, const ReductionSource& source, const std::string& store);

}  // namespace citylearn
