// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/layers/convolution.h"
#include "policy_service/network/layers/lstm.h"
#include "policy_service/network/layers/product.h"

namespace citylearn {
namespace {

/// The paper's agent that learns to see (section IV, after Mirowski et al., 2018): a picture in colour -> convolution
/// 8x8, stride 4, `maps` maps, relu -> convolution 4x4, stride 2, twice as many, relu -> with the goal destination g_t
/// = goal / N to the linear layer, and on as `features`.
///
/// Agents that stand at one frame see the same picture. Convolutions and the linear layer's share of the picture run
/// once for each distinct one, and backward the derivatives of all agents that saw it are added up first: exact, and a
/// route of N frames never costs more than N pictures, however many steps were made on it.
template <class S>
class RawImages : public LstmNetwork<S> {
  using Base = LstmNetwork<S>;
  using typename Base::Work;

 public:
  RawImages(const Parameters& parameters, const NetworkTask& task)
      : RawImages(parameters, task, first_convolution(parameters, task)) {}

  static std::vector<ParameterSpec> parameters() {
    std::vector<ParameterSpec> specs = Base::lstm_parameters();
    specs.push_back({"side", "pixels of a picture's side, as the encoder makes them", 84, 20, 512, true});
    specs.push_back({"maps", "maps of the first convolution; the second has twice as many", 16, 1, 256, true});
    specs.push_back({"scale", "colours, moved to -0.5..0.5, are multiplied by this", 4, 1e-3, 1e3});
    specs.push_back({"goal-scale", "the goal destination, moved to -0.5..0.5, is multiplied by this", 16, 1e-3, 1e3});
    return specs;
  }

  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Sight>(); }

  void initialise(Random& random, Vector<S>& parameters) const override {
    Base::initialise(random, parameters);
    orthogonal<S>(random, std::sqrt(2.0), this->layout_.view(parameters, weights1_));
    orthogonal<S>(random, std::sqrt(2.0), this->layout_.view(parameters, weights2_));
  }

 protected:
  void embed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
             Eigen::Block<Matrix<S>> embedded) const override {
    Sight& sight = static_cast<Sight&>(work);
    make_room(sight.shared, embedded.rows(), inputs.distinct);
    find_unknown(inputs, sight);
    const auto count = static_cast<std::ptrdiff_t>(sight.unknown.size());
    make_room(sight.maps1, first_.outputs(), count);
    make_room(sight.maps2, second_.outputs(), count);
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      look(inputs.features.col(sight.unknown[static_cast<std::size_t>(i)]), sight);
      convolve(first_, parameters, weights1_, bias1_, sight.patches1, sight.maps1.col(i).data());
      second_.gather(sight.maps1.col(i).data(), sight.patches2);
      convolve(second_, parameters, weights2_, bias2_, sight.patches2, sight.maps2.col(i).data());
    }
    const auto weights = this->layout_.view(parameters, this->sensor_weights_);
    const auto bias = this->layout_.view(parameters, this->sensor_bias_).col(0);
    make_room(sight.fresh, embedded.rows(), count);
    // What is remembered must not depend on which pictures were worked on with it, not even in the last bit.
    const std::ptrdiff_t together = work.fixed ? 1 : std::max<std::ptrdiff_t>(1, count);
    for (std::ptrdiff_t i = 0; i < count; i += together)
      set_product(sight.fresh.middleCols(i, together), weights.leftCols(second_.outputs()),
                  sight.maps2.middleCols(i, together));
    for (std::ptrdiff_t i = 0; i < count; ++i)
      sight.shared.col(sight.unknown[static_cast<std::size_t>(i)]) = sight.fresh.col(i);
    if (work.fixed) remember(inputs, sight);
    for (std::ptrdiff_t column = 0; column < embedded.cols(); ++column)
      embedded.col(column) = sight.shared.col(inputs.seen[static_cast<std::size_t>(column)]) + bias +
                             goal(inputs, column) * weights.col(second_.outputs());
  }

  void unembed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
               Vector<S>& gradient) const override {
    Sight& sight = static_cast<Sight&>(work);
    const std::ptrdiff_t distinct = inputs.distinct;
    const auto weights = this->layout_.view(parameters, this->sensor_weights_);
    auto by_weights = this->layout_.view(gradient, this->sensor_weights_);
    auto shared = sight.shared.leftCols(distinct);  // becomes the derivative by itself
    shared.setZero();
    for (std::ptrdiff_t column = 0; column < work.embedded_gradient.cols(); ++column) {
      const auto by_embedded = work.embedded_gradient.col(column);
      shared.col(inputs.seen[static_cast<std::size_t>(column)]) += by_embedded;
      by_weights.col(second_.outputs()) += goal(inputs, column) * by_embedded;
    }
    this->layout_.view(gradient, this->sensor_bias_) += work.embedded_gradient.rowwise().sum();
    add_product(by_weights.leftCols(second_.outputs()), shared, sight.maps2.leftCols(distinct).transpose());
    make_room(sight.by_maps2, second_.outputs(), distinct);
    set_product(sight.by_maps2.leftCols(distinct), weights.leftCols(second_.outputs()).transpose(), shared);
    sight.by_maps2.leftCols(distinct).array() *= (sight.maps2.leftCols(distinct).array() > S(0)).template cast<S>();

    const auto weights2 = this->layout_.view(parameters, weights2_);
    auto by_weights1 = this->layout_.view(gradient, weights1_), by_weights2 = this->layout_.view(gradient, weights2_);
    auto by_bias1 = this->layout_.view(gradient, bias1_), by_bias2 = this->layout_.view(gradient, bias2_);
    for (std::ptrdiff_t thing = 0; thing < distinct; ++thing) {
      const Eigen::Map<const Matrix<S>> by_out2(sight.by_maps2.col(thing).data(), second_.maps, second_.positions());
      second_.gather(sight.maps1.col(thing).data(), sight.patches2);
      add_product(by_weights2, by_out2, sight.patches2.transpose());
      by_bias2 += by_out2.rowwise().sum();
      set_product(sight.patches2, weights2.transpose(), by_out2);
      sight.by_maps1.setZero(first_.outputs());
      second_.scatter(sight.patches2, sight.by_maps1.data());
      sight.by_maps1.array() *= (sight.maps1.col(thing).array() > S(0)).template cast<S>();
      const Eigen::Map<const Matrix<S>> by_out1(sight.by_maps1.data(), first_.maps, first_.positions());
      look(inputs.features.col(thing),
           sight);  // gathered again: all patches of all pictures would not stay in the cache
      add_product(by_weights1, by_out1, sight.patches1.transpose());
      by_bias1 += by_out1.rowwise().sum();
    }
  }

 private:
  struct Sight : Work {
    Vector<S> picture;             // 3 side^2, of the one at work
    Matrix<S> patches1, patches2;  // of the one at work
    Matrix<S> maps1, maps2;        // outputs x at least U
    Matrix<S> by_maps2;            // outputs of the second x at least U
    Vector<S> by_maps1;            // outputs of the first, of the one at work
    Matrix<S> shared;              // hidden x at least U: the linear layer's share of the picture
    Matrix<S> fresh;               // hidden x at least `unknown`: of those worked on in this pass
    std::vector<int> unknown;      // things to work on, columns of `features`
    std::vector<int> place;        // U, where it is, or -1

    // While the parameters stay the same: by place, what was seen there and what was made of it.
    std::uint64_t memory_of = 0;       // Workspace::fixed
    std::vector<bool> known;           // N
    Matrix<S> seen_there, made_of_it;  // D x N, hidden x N
  };

  /// Things that are not remembered: all of them where a backward pass will follow.
  void find_unknown(const NetworkInputs<S>& inputs, Sight& sight) const {
    const auto places = static_cast<std::size_t>(frames_);
    sight.unknown.clear();
    if (sight.fixed != sight.memory_of) sight.known.assign(places, false);
    sight.memory_of = sight.fixed;
    sight.place.assign(static_cast<std::size_t>(inputs.distinct), -1);
    for (std::size_t column = 0; column < inputs.seen.size(); ++column)  // an environment shows one experience alone
      if (inputs.shown[column] >= 0)
        sight.place[static_cast<std::size_t>(inputs.seen[column])] = inputs.shown[column] % inputs.frames;
    for (int thing = 0; thing < inputs.distinct; ++thing) {
      const int place = sight.place[static_cast<std::size_t>(thing)];
      if (sight.fixed && place >= 0 && sight.known[static_cast<std::size_t>(place)] &&
          sight.seen_there.col(place) == inputs.features.col(thing))
        sight.shared.col(thing) = sight.made_of_it.col(place);
      else
        sight.unknown.push_back(thing);
    }
  }

  void remember(const NetworkInputs<S>& inputs, Sight& sight) const {
    make_room(sight.seen_there, inputs.features.rows(), frames_);
    make_room(sight.made_of_it, sight.shared.rows(), frames_);
    for (const int thing : sight.unknown) {
      const int place = sight.place[static_cast<std::size_t>(thing)];
      if (place < 0) continue;
      sight.known[static_cast<std::size_t>(place)] = true;
      sight.seen_there.col(place) = inputs.features.col(thing);
      sight.made_of_it.col(place) = sight.shared.col(thing);
    }
  }

  RawImages(const Parameters& parameters, const NetworkTask& task, const Convolution& first)
      : Base(parameters, static_cast<int>(second_convolution(first).outputs()) + 1),
        first_(first),
        second_(second_convolution(first)),
        frames_(task.frames),
        places_(task.places()),
        scale_(static_cast<S>(parameters["scale"])),
        goal_scale_(static_cast<S>(parameters["goal-scale"])) {
    weights1_ = this->layout_.add("convolution.1.weight", first_.maps, first_.patch());
    bias1_ = this->layout_.add("convolution.1.bias", first_.maps, 1);
    weights2_ = this->layout_.add("convolution.2.weight", second_.maps, second_.patch());
    bias2_ = this->layout_.add("convolution.2.bias", second_.maps, 1);
  }

  static Convolution first_convolution(const Parameters& parameters, const NetworkTask& task) {
    const Convolution first{parameters.integer("side"), 3, 8, 4, parameters.integer("maps")};
    if (task.features != first.inputs())
      throw Error("are " + std::to_string(task.features) + ", a picture of " + std::to_string(first.side) + " x " +
                      std::to_string(first.side) + " pixels in colour has " + std::to_string(first.inputs()),
                  "features", "give it pictures by an encoder_service with --encoder raw84");
    return first;
  }
  static Convolution second_convolution(const Convolution& first) {
    return {first.out_side(), first.maps, 4, 2, 2 * first.maps};
  }

  /// Gives a matrix at least `cols` columns. It keeps its contents when it has as many already.
  static void make_room(Matrix<S>& matrix, std::ptrdiff_t rows, std::ptrdiff_t cols) {
    if (matrix.rows() != rows || matrix.cols() < cols) matrix.resize(rows, cols);
  }

  template <class Picture>
  void look(const Picture& picture, Sight& sight) const {
    sight.picture = scale_ * (picture.array() - S(0.5));
    first_.gather(sight.picture.data(), sight.patches1);
  }

  void convolve(const Convolution& convolution, const Vector<S>& parameters, std::size_t weights, std::size_t bias,
                const Matrix<S>& patches, S* maps) const {
    Eigen::Map<Matrix<S>> out(maps, convolution.maps, convolution.positions());
    set_product(out, this->layout_.view(parameters, weights), patches);
    out = (out.colwise() + this->layout_.view(parameters, bias).col(0)).cwiseMax(S(0));
  }

  S goal(const NetworkInputs<S>& inputs, std::ptrdiff_t column) const {
    return goal_scale_ *
           (static_cast<S>(inputs.goal[static_cast<std::size_t>(column)]) / static_cast<S>(places_) - S(0.5));
  }

  Convolution first_, second_;
  int frames_, places_;
  S scale_, goal_scale_;
  std::size_t weights1_, bias1_, weights2_, bias2_;
};

const NetworkRegistration<RawImages> raw_images_registration{
    "raw_images",
    "the paper's agent that learns to see: 84 x 84 pixels in colour -> "
    "two convolutions, with the goal -> linear 512 -> "
    "LSTM 256",
    RawImages<NetworkScalar>::parameters(),
    RawImages<NetworkScalar>::recommended({{"agents", 32},
                                           {"sequence", 64},
                                           {"steps", 200000},
                                           {"noise-frame", 0},
                                           {"noise-episode", 0},
                                           {"minibatch", 16},
                                           {"epochs", 2},
                                           {"learning-rate", 1e-3},
                                           {"gamma", 0.9},
                                           {"lambda", 0.8},
                                           {"localisation", 3}})};

}  // namespace
}  // namespace citylearn
