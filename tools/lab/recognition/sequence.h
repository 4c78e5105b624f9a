// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "tools/lab/recognition/scores.h"

namespace citylearn {

struct SequenceOptions {
  int length = 21;      ///< frames of a sequence, odd: as many before the frame as after it
  bool causal = false;  ///< all others before the frame, none after it; `length` may be even then
  /// Reference frames passed per query frame; of several the best counts.
  double slowest = 1;
  double fastest = 1;
};

/// Returns the mean similarity along the straight line through each entry of an R x Q similarity, over a sequence
/// centred there: S'(r, q) = max over v of mean over k = -h..h of S(r + round(v k), q + k). At the matrix's edges the
/// mean is over the part of the line that is inside. Looks h frames ahead; a causal sequence, k = 1 - length..0, does
/// not. Throws Error: an even length of a centred sequence, or velocities not in 0.1..10.
Scores sequence_similarity(Scores similarity, const SequenceOptions& options);

/// SeqSLAM's local contrast enhancement (Milford & Wyeth, ICRA 2012, equation 4) of a query's R differences: each minus
/// the mean of the reference frames within window / 2 of it, divided by their standard deviation (n - 1). Where the
/// window is constant the contrast is 0. SeqSLAM shifts all so that the least is 0. Throws Error: a window without
/// frames.
Eigen::VectorXd local_contrast(const Eigen::Ref<const Eigen::VectorXd>& difference, int window = 10);
/// Returns the least contrast of all scores as differences.
double least_contrast(const Scores& scores, int window);

/// OpenSeqSLAM's parameters (Suenderhauf, Neubert & Protzel, ICRA workshop 2013), with its values.
struct SeqSlamOptions {
  int length = 10;       ///< ds: a trajectory passes length + 1 query frames; even
  double slowest = 0.8;  ///< vmin, reference frames per query frame
  double fastest = 1.2;  ///< vmax
  int window = 10;       ///< Rwindow: frames around the best match among which no rival is looked for
};

struct SeqSlam {
  /// R x Q: least sum of differences along a trajectory centred at (reference, query); infinite where none fits.
  Eigen::MatrixXd costs;
  /// Q: reference frame of the least cost, -1 where no trajectory fits (the first and last length / 2 queries).
  Eigen::VectorXi matches;
  /// Q: that cost / the least cost outside of the window around it. Small is sure; 1 is a toss-up. NaN without a match.
  Eigen::VectorXd ratios;
};

/// SeqSLAM's search for straight trajectories of several velocities (section III.B; velocities are tried so far apart
/// that the ends of the trajectories differ by one frame, as OpenSeqSLAM does) in contrast-enhanced differences.
/// Throws Error: length not even, or velocities not in 0.1..10.
SeqSlam seqslam(const Eigen::Ref<const Eigen::MatrixXd>& difference, const SeqSlamOptions& options);

}  // namespace citylearn
