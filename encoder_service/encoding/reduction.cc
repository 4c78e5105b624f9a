// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/reduction.h"

#include <spdlog/spdlog.h>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>
#include <cstdint>

#include "core/util/error.h"
#include "core/util/random.h"
#include "encoder_service/encoding/byte_stream.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn {
namespace {

using Eigen::Index;
using Eigen::MatrixXf;
using Eigen::VectorXd;
using Eigen::VectorXf;

constexpr double kMinEigenvalue = 1e-6;  // of the largest; what is below is rounding
const std::string kFormat = "citylearn reduction 1";

struct Eigenpairs {
  VectorXf values;   ///< decreasing
  MatrixXf vectors;  ///< a column each
};

/// Returns the `count` largest of a positive semidefinite matrix.
Eigenpairs all_eigenpairs(const MatrixXf& matrix, Index count) {
  const Eigen::SelfAdjointEigenSolver<MatrixXf> solver(matrix);
  if (solver.info() != Eigen::Success) throw Error("the eigenvalues of the descriptors cannot be found");
  return {solver.eigenvalues().tail(count).reverse(), solver.eigenvectors().rightCols(count).rowwise().reverse()};
}

/// Returns the same by subspace iteration with half as many vectors again as wanted (Halko, Martinsson & Tropp, SIAM
/// Review 2011): far quicker when few are wanted.
Eigenpairs leading_eigenpairs(const MatrixXf& matrix, Index count) {
  const Index width = count + std::max<Index>(16, count / 2);
  Random random{0x5EED, static_cast<std::uint64_t>(matrix.rows())};
  MatrixXf basis(matrix.rows(), width);
  for (Index i = 0; i < basis.size(); ++i) basis.data()[i] = static_cast<float>(random.normal());
  const auto orthonormalise = [&](const MatrixXf& vectors) {
    const Eigen::HouseholderQR<MatrixXf> qr(vectors);
    basis = qr.householderQ() * MatrixXf::Identity(matrix.rows(), width);
  };
  orthonormalise(basis);
  VectorXf before = VectorXf::Zero(count);
  for (int round = 0;; ++round) {
    const MatrixXf image = matrix * basis;
    const MatrixXf small = basis.transpose() * image;
    Eigenpairs inner = all_eigenpairs(0.5f * (small + small.transpose()), width);
    const VectorXf values = inner.values.head(count);
    if (round == 60 || (values - before).cwiseAbs().maxCoeff() <= 1e-6f * values[0])
      return {values, basis * inner.vectors.leftCols(count)};
    before = values;
    orthonormalise(image);
  }
}

Eigenpairs largest_eigenpairs(const MatrixXf& matrix, Index count) {
  // From 64 on the iterated vectors are always fewer than the rows.
  return matrix.rows() >= 64 && count * 6 < matrix.rows() ? leading_eigenpairs(matrix, count)
                                                          : all_eigenpairs(matrix, count);
}

void add_to(VectorXd& sum, const Eigen::Ref<const MatrixXf>& descriptors) {
  for (const auto column : descriptors.colwise()) sum += column.cast<double>();
}

/// Divides columns by their length, except those of zeros.
void normalise_columns(Eigen::Ref<MatrixXf> features) {
  for (auto column : features.colwise()) {
    const float length = column.stableNorm();
    if (length > 0) column /= length;
  }
}

VectorXf mean_of(const MatrixXf& descriptors) {
  VectorXd sum = VectorXd::Zero(descriptors.rows());
  add_to(sum, descriptors);
  return (sum / static_cast<double>(descriptors.cols())).cast<float>();
}

/// d x D principal axes of centred descriptors (D x F), each divided by its eigenvalue^exponent.
MatrixXf whitened_axes(const MatrixXf& centred, Index count, double exponent) {
  const float frames = static_cast<float>(centred.cols());
  const bool wide = centred.rows() > centred.cols();
  const Index size = std::min(centred.rows(), centred.cols());
  // With more numbers than frames the F x F products of frames have the same eigenvalues, and their eigenvectors give
  // the axes.
  MatrixXf products = MatrixXf::Zero(size, size);
  if (wide)
    products.selfadjointView<Eigen::Lower>().rankUpdate(centred.transpose(), 1 / frames);
  else
    products.selfadjointView<Eigen::Lower>().rankUpdate(centred, 1 / frames);
  products.triangularView<Eigen::StrictlyUpper>() = products.transpose();

  const Eigenpairs pairs = largest_eigenpairs(products, count);
  MatrixXf axes = pairs.vectors.transpose();
  if (wide) axes *= centred.transpose();
  for (Index i = 0; i < count; ++i) {
    // Fewer independent frames than axes: the surplus axes are rounding, which whitening would blow up.
    if (!(pairs.values[i] > kMinEigenvalue * pairs.values[0]))
      axes.row(i).setZero();
    else
      axes.row(i) *= static_cast<float>(std::pow(pairs.values[i], -exponent)) / axes.row(i).norm();
  }
  return axes;
}

void check_options(const ReductionOptions& options, Index rows, Index columns) {
  if (rows < 1 || columns < 1) throw Error("no descriptors to learn a reduction from", "reference");
  const int most = Reduction::largest_dimension(rows, columns);
  if (options.dimension < 0 || options.dimension > most)
    throw Error("is " + std::to_string(options.dimension), "dimension",
                "0 to " + std::to_string(most) + ": the reference has " + std::to_string(columns) + " frames of " +
                    std::to_string(rows) + " numbers");
  if (!(options.whitening >= 0 && options.whitening <= 1))
    throw Error("is " + std::to_string(options.whitening), "whitening",
                "an exponent from 0 to 1; 0.5 is full whitening");
}

}  // namespace

Centring centring_of(const std::string& name) {
  if (name == "none") return Centring::kNone;
  if (name == "reference") return Centring::kReference;
  if (name == "own") return Centring::kOwn;
  if (name == "running") return Centring::kRunning;
  throw Error("unknown centring '" + name + "'", "", "known: none, reference, own, running");
}

std::string name_of(Centring centring) {
  switch (centring) {
    case Centring::kNone:
      return "none";
    case Centring::kReference:
      return "reference";
    case Centring::kOwn:
      return "own";
    case Centring::kRunning:
      break;
  }
  return "running";
}

Reduction Reduction::learn(MatrixXf reference, const ReductionOptions& options) {
  check_options(options, reference.rows(), reference.cols());
  if (!reference.allFinite()) throw Error("a descriptor that is not finite", "reference");
  if (reference.cols() > kMaxSample)
    reference = reference(Eigen::all, training_frames(kMaxSample, static_cast<int>(reference.cols()))).eval();
  if (reference.cols() > 1 && (reference.colwise() - reference.col(0)).isZero(0))
    spdlog::warn("all {} descriptors of the reference are equal: no place can be told from another", reference.cols());
  if (options.dimension > 0 && options.whitening >= 0.5 && 2 * options.dimension > reference.cols() - 1)
    spdlog::warn(
        "full whitening to {} dimensions from {} frames: the last ones are noise; take fewer or an exponent of 0.2",
        options.dimension, reference.cols());
  Reduction reduction;
  reduction.options_ = options;
  reduction.mean_ = options.centring == Centring::kNone ? VectorXf::Zero(reference.rows()).eval() : mean_of(reference);
  if (options.dimension == 0) return reduction;
  reference.colwise() -= reduction.mean_;
  reduction.projection_ = whitened_axes(reference, options.dimension, options.whitening);
  return reduction;
}

int Reduction::dimension() const { return options_.dimension > 0 ? options_.dimension : input_dimension(); }

void Reduction::check_input(Index numbers) const {
  if (numbers != mean_.size())
    throw Error("descriptors of " + std::to_string(numbers) + " numbers, the reduction was learned on " +
                std::to_string(mean_.size()));
}

MatrixXf Reduction::apply(const Eigen::Ref<const MatrixXf>& descriptors) const {
  check_input(descriptors.rows());
  return apply(descriptors.cols(),
               [&](Index first, Eigen::Ref<MatrixXf> block) { block = descriptors.middleCols(first, block.cols()); });
}

MatrixXf Reduction::apply(Index frames, const ReadBlock& read) const {
  MatrixXf features(dimension(), frames);
  if (options_.keeps_all()) {
    read(0, features);
    return features;
  }
  // Without PCA descriptors become features where they lie.
  MatrixXf descriptors;
  const auto for_each_block = [&](const auto& use) {
    for (Index first = 0; first < frames; first += kMaxSample) {
      const Index count = std::min<Index>(kMaxSample, frames - first);
      if (options_.dimension > 0) descriptors.resize(input_dimension(), count);
      auto block = options_.dimension > 0 ? descriptors.leftCols(count) : features.middleCols(first, count);
      read(first, block);
      use(first, block);
    }
  };
  VectorXf mean = mean_;
  if (options_.centring == Centring::kOwn && frames > 0) {
    VectorXd sum = VectorXd::Zero(mean_.size());
    for_each_block([&](Index, const auto& block) { add_to(sum, block); });
    mean = (sum / static_cast<double>(frames)).cast<float>();
  }
  RunningMean running(mean_);
  for_each_block([&](Index first, auto& block) {
    if (options_.centring == Centring::kRunning)
      for (auto column : block.colwise()) column = running.centre(column);
    else
      block.colwise() -= mean;
    if (options_.dimension > 0)
      features.middleCols(first, block.cols()) = project(block);
    else
      normalise_columns(block);
  });
  return features;
}

MatrixXf Reduction::project(const Eigen::Ref<const MatrixXf>& centred) const {
  MatrixXf features = options_.dimension > 0 ? (projection_ * centred).eval() : MatrixXf(centred);
  normalise_columns(features);
  return features;
}

VectorXf RunningMean::centre(const Eigen::Ref<const VectorXf>& descriptor) {
  sum_ += descriptor.cast<double>();
  ++count_;
  return descriptor - (sum_ / (kPrior + static_cast<double>(count_))).cast<float>();
}

OnlineReduction::OnlineReduction(std::shared_ptr<const Reduction> reduction)
    : reduction_(std::move(reduction)), mean_(reduction_->mean()) {}

VectorXf OnlineReduction::apply(const Eigen::Ref<const VectorXf>& descriptor) {
  const ReductionOptions& options = reduction_->options();
  if (options.keeps_all()) return descriptor;
  if (options.centring == Centring::kRunning) return reduction_->project(mean_.centre(descriptor));
  return reduction_->project(descriptor - reduction_->mean());
}

Bytes Reduction::save(const std::string& encoder) const {
  ByteWriter out;
  out.put_text(kFormat);
  out.put_text(encoder);
  out.put(static_cast<std::uint32_t>(options_.centring));
  out.put(static_cast<std::uint32_t>(options_.dimension));
  out.put(options_.whitening);
  out.put(static_cast<std::uint32_t>(mean_.size()));
  out.put(mean_.data(), static_cast<std::size_t>(mean_.size()));
  out.put(projection_.data(), static_cast<std::size_t>(projection_.size()));
  return out.finish();
}

Reduction Reduction::load(std::span<const std::byte> bytes, const std::string& encoder, const std::string& where) {
  ByteReader in(bytes, "reduction", where);
  if (in.get_text() != kFormat) throw Error("not a reduction, or one of another version", where, "learn it again");
  const std::string name = in.get_text();
  if (name != encoder)
    throw Error("belongs to the encoder '" + name + "', not to '" + encoder + "'", where, "learn one for this encoder");
  Reduction reduction;
  const auto centring = in.get<std::uint32_t>();
  const auto dimension = in.get<std::uint32_t>();
  const auto whitening = in.get<double>();
  const auto rows = in.get<std::uint32_t>();
  // Sizes are checked against what is there before anything is allocated.
  const std::uint64_t numbers = static_cast<std::uint64_t>(rows) * (1 + static_cast<std::uint64_t>(dimension));
  if (centring > static_cast<std::uint32_t>(Centring::kRunning) || !(whitening >= 0 && whitening <= 1) || rows == 0 ||
      rows > INT32_MAX || dimension > rows || in.left() % sizeof(float) != 0 || numbers != in.left() / sizeof(float))
    in.fail();
  reduction.options_ = {static_cast<Centring>(centring), static_cast<int>(dimension), whitening};
  reduction.mean_.resize(rows);
  in.get(reduction.mean_.data(), rows);
  if (dimension > 0) reduction.projection_.resize(dimension, rows);
  in.get(reduction.projection_.data(), static_cast<std::size_t>(reduction.projection_.size()));
  if (!reduction.mean_.allFinite() || !reduction.projection_.allFinite()) in.fail();
  return reduction;
}

}  // namespace citylearn
