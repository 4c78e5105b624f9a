// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "encoder_service/pipeline/background_queue.h"
#include "encoder_service/pipeline/descriptor_exchange.h"
#include "encoder_service/pipeline/encoded_traversal.h"
#include "encoder_service/pipeline/encoder_service_options.h"
#include "encoder_service/pipeline/learned_files.h"

namespace citylearn {

/// Turns the images of traversals into features. It fetches each image and encodes it, unless another encoder_service
/// has: then it fetches the descriptor. It learns the reduction from the reference traversal and applies it. Encoding
/// and reducing run on threads of their own. Used by the node's thread.
class EncodingPipeline {
 public:
  /// Returns the id of a live env_service that has the images of the traversal with this hash, under this name if one
  /// is given; empty where there is none.
  using FindHost = std::function<std::string(std::uint64_t hash, const std::string& name)>;

  /// `node` must outlive it. Throws Error when the encoder is unknown, its parameters or files are wrong, or the store
  /// cannot be created.
  EncodingPipeline(Node& node, const EncoderServiceOptions& options, FindHost find_host);

  /// Adds a traversal unless it is known. Recordings of equal contents are encoded once, whatever their names.
  void add(const msg::TraversalInfo& info);
  /// Returns a traversal by its hash; null when it is unknown.
  const EncodedTraversal* find(std::uint64_t hash) const;
  /// Requests features of frames of a live traversal (core/task/live.h), where they are not made yet.
  void want(std::uint64_t hash, std::span<const std::uint32_t> frames);

  void on_positions(const msg::TraversalChunk& chunk);
  void on_image(const msg::ImageChunk& chunk);

  /// Does all that can be done now without waiting. Throws what an encoder throws.
  void advance(Clock::time_point now);
  /// Returns the exchange of descriptors with the other encoder_services of the session.
  DescriptorExchange& exchange() { return exchange_; }
  /// Takes over what the encoding thread has done, and stores it.
  void finish() { encoding_.run_completions(); }

  /// Returns whether the encoder has learned from the reference, or need not. From then on there is a feature_recipe().
  bool encoder_ready() const { return encoder_ready_; }
  /// Returns how features are made. Equal texts mean equal features.
  FeatureRecipe feature_recipe() const;
  bool busy() const;                                  ///< Returns whether features are still to be made.
  std::uint64_t encoded() const { return encoded_; }  ///< frames encoded here
  /// Returns what ServiceStatus is to say: FAILED and why, else the work on the first traversal that is not ready.
  /// Returns nothing when all are ready.
  std::optional<std::pair<msg::State, std::string>> status(Clock::time_point now) const;

 private:
  struct Batch;

  void learn_encoder();
  bool restore_encoder(const std::string& path);
  void finish_training_sample();
  void encode_traversals();
  void divide_work(EncodedTraversal& traversal, int& ahead);
  void forget(EncodedTraversal& traversal, const std::vector<int>& frames);
  void encode(EncodedTraversal& traversal, bool incomplete_batches);
  void begin_live(EncodedTraversal& traversal);
  void store_batch(const Batch& batch, EncodedTraversal& traversal);
  void reduce_traversals();
  void reduce(EncodedTraversal& traversal);
  void send_requests();

  bool needs_reference() const { return options_.reduction.learns(); }
  EncodedTraversal* reference() const;
  bool has_host(const EncodedTraversal& traversal) const { return !find_host_(traversal.hash, "").empty(); }
  std::string encoder_path(std::uint64_t traversal) const;

  Node& node_;
  const EncoderServiceOptions options_;
  const FindHost find_host_;
  DescriptorExchange exchange_;
  std::unique_ptr<Encoder> encoder_;  // used by the encoding thread, apart from its spec
  std::string encoder_recipe_;        // the encoder's name and parameters, before it has learned anything
  bool sampling_ = false, encoder_ready_ = false;
  Encoder::Spec spec_;  // once encoder_ready_
  std::vector<FetchedImage> training_sample_;
  std::shared_ptr<const Reduction> reduction_;
  std::uint64_t reduction_source_ = 0;                                     // FeatureRecipe::learned_on of reduction_
  std::map<std::uint64_t, std::unique_ptr<EncodedTraversal>> traversals_;  // by hash
  Clock::time_point now_;
  std::uint64_t encoded_ = 0;
  msg::TraversalRequest request_;
  msg::ImageRequest image_request_;

  // Last: their threads end before what they use. Reductions are learned while other traversals are encoded.
  BackgroundQueue encoding_, reducing_;
};

}  // namespace citylearn
