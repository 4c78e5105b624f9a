// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/picture_encoder.h"
#include "tools/export/encoder_graph.h"

namespace citylearn {
namespace {

/// Appends what encoders/raw84.cc computes.
std::unique_ptr<EncoderGraph> append_raw84(const Parameters& parameters, const EncoderFiles&,
                                           const OnnxPicture& picture) {
  OnnxPicture colours = scaled(picture, kRaw84Side, kRaw84Side, true);
  if (parameters["sigma"] == 0) {
    colours.value = 1 / 255.f * colours.value;
  } else {
    colours = sliding_normalised(colours, parameters["sigma"]);
    colours.value = static_cast<float>(1 / kRaw84Deviations) * colours.value + 0.5f;
    colours = limited(colours, 1);
  }
  return std::make_unique<EncoderGraph>(flattened(colours, true));
}

const EncoderGraphRegistry::Registration raw84_registration{{"raw84", "as encoders/raw84.cc", {}, append_raw84}};

}  // namespace
}  // namespace citylearn
