// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "tools/export/picture_graph.h"

namespace citylearn {

/// An encoder's descriptor within a graph, batch x D.
struct EncoderGraph {
  OnnxValue descriptor;
};

/// Writers of encoders as ONNX operators, by the encoder's name: one file each under encoders/, which ends in a static
/// Registration. They get the encoder's own parameters and files, and a picture in red, green, blue, 0..255.
using EncoderGraphRegistry = Registry<EncoderGraph, const EncoderFiles&, const OnnxPicture&>;

/// Throws Error that lists the encoders that can be written when this one cannot.
void require_exportable(const std::string& encoder);

/// Throws Error for a mean of the whole traversal (Centring::kOwn), which no single picture has.
void require_exportable(Centring centring);

/// Appends the encoder to the picture's graph; returns its descriptor. Throws Error as require_exportable().
OnnxValue append_encoder(const OnnxPicture& picture, const std::string& encoder, const Parameters& parameters,
                         const EncoderFiles& files);

/// Appends the reduction of a descriptor; returns the features, batch x d. A running mean adds an input `seen` (sums of
/// the descriptors of frames before this one, then their number) and an output `next_seen`. Throws Error as
/// require_exportable().
OnnxValue append_reduction(const OnnxValue& descriptor, const Reduction& reduction);

/// Returns `sums` (batch x D + 1: sums, then a count) after one more of `numbers`, batch x D.
OnnxValue counted(const OnnxValue& sums, const OnnxValue& numbers);

}  // namespace citylearn
