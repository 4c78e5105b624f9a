// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "policy_service/interchange/export.h"

namespace citylearn {

/// Pixels of the pictures that an exported file takes.
struct PictureSize {
  int width = 0, height = 0;
};
/// Parses "160x96". Throws Error.
PictureSize picture_size(const std::string& text);

struct PictureExportOptions {
  ExportOptions agent;  ///< its checkpoint and parameters, and the file to write, NAME.onnx
  std::string encoder;  ///< name; empty: the one that the checkpoint names
  std::map<std::string, std::map<std::string, double>> parameters;  ///< given ones, by encoder
  EncoderFiles files;
  PictureSize picture;
  std::string reduction_file;  ///< of the reduction; empty: the one in `store` that the checkpoint names
  std::string store;           ///< of the encoder_service that the agent learned with
};

/// Writes encoder, reduction and agent as one ONNX file, from a picture to an action
/// (docs/reference/export-formats.md). Throws Error naming the option or file, also when they do not belong together.
void export_picture_agent(const PictureExportOptions& options);

/// An encoder with its parameters, files and reduction.
struct PictureEncoding {
  std::string encoder;
  Parameters parameters;
  EncoderFiles files;
  PictureSize picture;
  Reduction reduction;
};
/// Returns that file's bytes, with `metadata`. Throws Error.
std::string picture_agent_bytes(const PictureEncoding& encoding, const TrainedAgent& agent,
                                const Parameters& network_parameters,
                                const std::map<std::string, std::string>& metadata);

}  // namespace citylearn
