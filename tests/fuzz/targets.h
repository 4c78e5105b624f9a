// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdlib>
#include <iostream>
#include <span>
#include <string_view>

#include "core/util/error.h"

// Readers of what comes from outside, each as one function of arbitrary bytes. libFuzzer calls them with inputs it
// invents (tests/fuzz/README.md), a unit test with the seeds. Whatever the bytes are, a reader either takes them or
// throws an Error of one line; all else is a finding. Each function tells whether they were taken.

namespace citylearn::fuzz {

using Input = std::span<const std::byte>;

/// NAME.csv of the dataset plain.
bool features_csv(Input input);
/// A text file of fields; the first byte chooses the separator and whether there is a header.
bool text_table(Input input);
/// A folder of files for any dataset: the first line names the dataset, then each line "=== NAME" begins a file, whose
/// contents go on to the next such line. Everything in it is loaded, read, matched, aligned.
bool dataset_folder(Input input);
/// A file of the feature store: as it is, and again with its header's checksum put right.
bool feature_store(Input input);
/// An image file: its header, image_fault(), and decoded when it has at most 2 megapixels.
bool picture(Input input);
/// Reads what encoders read beside pictures. The first byte chooses: a reduction, or the frame of an ONNX
/// model (the model itself is OpenCV's to read).
bool encoder_file(Input input);
/// A recording: all its messages, their headers, and those changed to another run. Taken when it is whole.
bool mcap_file(Input input);
/// Reads what a browser sends to the dashboard: the target of a request, then lines Host, Origin, Authorization and
/// Cookie, then the message of a WebSocket. Returns true when the API has an answer.
bool web_request(Input input);
/// A run of TensorBoard or W&B that is imported. The first byte chooses: an event file, an event of one, a file of W&B,
/// a record of one. Taken when it is whole and has points.
/// A message of the type whose topic is citylearn/$CITYLEARN_FUZZ_MESSAGE, as it comes over the wire.
bool message(Input input);

struct Target {
  std::string_view name;
  bool (*run)(Input);
};
inline constexpr Target kTargets[] = {
    {"features_csv", features_csv},   {"text_table", text_table},   {"dataset_folder", dataset_folder},
    {"feature_store", feature_store}, {"picture", picture},         {"encoder_file", encoder_file},
    {"mcap_file", mcap_file},         {"web_request", web_request},
};

/// Ends the process when something does not hold.
inline void require(bool holds, std::string_view what) {
  if (holds) return;
  std::cerr << "finding: " << what << std::endl;
  std::abort();
}

/// Runs `action`, which may end in an Error. True when it did not.
template <class Action>
bool accepted(const Action& action) {
  try {
    action();
    return true;
  } catch (const Error& error) {
    const std::string_view message = error.what();
    require(!message.empty() && message.find_first_of("\n\r\0", 0, 3) == message.npos, "an Error is one line");
    return false;
  }
}

}  // namespace citylearn::fuzz
