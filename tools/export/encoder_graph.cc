// SPDX-License-Identifier: Apache-2.0
#include "tools/export/encoder_graph.h"

#include <algorithm>

namespace citylearn {
namespace {

/// batch x 1, of ones.
OnnxValue ones_beside(const OnnxValue& numbers) { return 0 * numbers.graph->columns(numbers, 0, 1) + 1; }

}  // namespace

void require_exportable(const std::string& encoder) {
  const auto entries = EncoderGraphRegistry::instance().entries();
  if (std::any_of(entries.begin(), entries.end(), [&](const auto* entry) { return entry->name == encoder; })) return;
  throw Error("encoder '" + encoder + "' cannot be written as ONNX operators", "",
              "these can: " + joined(entries, &EncoderGraphRegistry::Entry::name) +
                  "; without --picture the agent is written alone, which takes features");
}

void require_exportable(Centring centring) {
  if (centring == Centring::kOwn)
    throw Error("was 'own', the mean of a whole traversal, which an exported file has not seen", "centring",
                "train with an encoder_service --centring running, reference or none");
}

OnnxValue append_encoder(const OnnxPicture& picture, const std::string& encoder, const Parameters& parameters,
                         const EncoderFiles& files) {
  require_exportable(encoder);
  return EncoderGraphRegistry::instance().find("encoder", encoder).create(parameters, files, picture)->descriptor;
}

OnnxValue counted(const OnnxValue& sums, const OnnxValue& numbers) {
  return sums + numbers.graph->concat({numbers, ones_beside(numbers)});
}

OnnxValue append_reduction(const OnnxValue& descriptor, const Reduction& reduction) {
  require_exportable(reduction.options().centring);
  if (reduction.options().keeps_all()) return descriptor;
  OnnxGraph& graph = *descriptor.graph;
  const std::int64_t width = reduction.input_dimension();
  const Matrix<float> mean = reduction.mean();
  OnnxValue centre;
  if (reduction.options().centring == Centring::kRunning) {
    const OnnxValue seen =
        counted(graph.input("seen", width + 1,
                            "sums of the encoder's descriptors of the frames of this traversal before this one, then "
                            "their number: next_seen of the frame before; zeros: none"),
                descriptor);
    graph.output("next_seen", seen, width + 1, "to be given as seen with the traversal's next frame");
    const OnnxValue weight =
        exp(-1 * log(graph.columns(seen, width, width + 1) + static_cast<float>(RunningMean::kPrior)));
    centre = graph.columns(seen, 0, width) * graph.stretched(weight, width) +
             graph.linear(weight, "reduction.prior", static_cast<float>(RunningMean::kPrior) * mean);
  } else {
    centre = graph.linear(ones_beside(descriptor), "reduction.mean", mean);
  }
  OnnxValue features = descriptor - centre;
  if (reduction.projection().size() > 0)
    features = graph.linear(features, "reduction.projection", reduction.projection());
  return graph.unit_length(features, reduction.dimension());
}

}  // namespace citylearn
