// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/encoding_pipeline.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/core.hpp>
#include <thread>

#include "core/exchange/timing.h"
#include "core/files/files.h"
#include "encoder_service/encoding/picture_encoder.h"
#include "encoder_service/pipeline/reduced_traversal.h"

namespace citylearn {
namespace {

constexpr std::chrono::seconds kProgressInterval{2};
constexpr std::size_t kMaxBacklogBytes = std::size_t{64} << 20;  // bytes of a traversal's images that wait for encoding

std::string_view as_text(const Bytes& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

std::string duration(double seconds) {
  if (seconds < 90) return fmt::format("{:.0f} s", seconds);
  return seconds < 5400 ? fmt::format("{:.0f} min", seconds / 60) : fmt::format("{:.1f} h", seconds / 3600);
}

/// A frame's picture, or why there is none.
struct DecodedImage {
  int frame = 0;
  cv::Mat picture;
  std::string fault;
};

/// Decodes images on all threads.
std::vector<DecodedImage> decode(const std::vector<FetchedImage>& images) {
  std::vector<DecodedImage> result(images.size());
  for_each_on_threads(static_cast<int>(images.size()), [&](int i) {
    const FetchedImage& image = images[static_cast<std::size_t>(i)];
    DecodedImage& decoded = result[static_cast<std::size_t>(i)];
    decoded.frame = image.frame;
    try {
      if (image.file.empty()) throw Error(image.name);
      decoded.picture = decode_picture(image.file, image.name);
    } catch (const Error& error) {
      decoded.fault = error.what();
    }
  });
  return result;
}

}  // namespace

std::string EncodedTraversal::time_left(Clock::time_point now) const {
  const int left = frames - work->done(), new_here = work->made() + work->fetched();
  if (new_here == 0 || left == 0) return "";
  return duration(std::chrono::duration<double>(now - since).count() / new_here * left);
}

/// Images that came over the wire, for the encoding thread.
struct EncodingPipeline::Batch {
  std::vector<FetchedImage> images;
  std::vector<int> frames;  // of those encoded: a column each of
  Eigen::MatrixXf descriptors;
  std::vector<std::pair<int, std::string>> faults;  // frame, reason
};

EncodingPipeline::EncodingPipeline(Node& node, const EncoderServiceOptions& options, FindHost find_host)
    : node_(node), options_(options), find_host_(std::move(find_host)), exchange_(node) {
  const auto& entry = EncoderRegistry::instance().find("encoder", options_.encoder);
  const Parameters parameters("encoder " + entry.name, entry.parameters, options_.parameters);
  // An encoder in Python takes many seconds to start. The heartbeats say so meanwhile, and others wait for it.
  node_.report(msg::STARTING, "starting " + (options_.files.model.empty() ? entry.name : options_.files.model));
  bool made = false;
  encoding_.post([&] { encoder_ = entry.create(parameters, options_.files); }, [&made] { made = true; });
  while (encoding_.run_completions(), !made) {
    node_.publish_heartbeat_if_due();
    std::this_thread::sleep_for(kEncoderBusyInterval);
  }
  encoder_recipe_ = entry.name;
  for (const auto& [name, value] : parameters.values()) encoder_recipe_ += fmt::format(" {}={:g}", name, value);
  const EncoderFiles& files = options_.files;
  for (const std::string& file : {files.model, files.layer, files.preset}) encoder_recipe_ += " " + file;
  if (encoder_->training_sample_count() == 0) {
    encoder_ready_ = true;
    spec_ = encoder_->spec();
    spdlog::info("encoder {}: {} numbers a picture", spec_.name, spec_.dimension);
  }
  if (options_.store.empty()) return;
  create_folder(options_.store, "choose another --store");
}

void EncodingPipeline::add(const msg::TraversalInfo& info) {
  const std::string name = info.traversal().c_str();
  std::unique_ptr<EncodedTraversal>& traversal = traversals_[info.hash()];
  if (!traversal) traversal = std::make_unique<EncodedTraversal>(info);
  if (traversal->names.contains(name)) return;
  spdlog::info("traversal {} of {}: {} frames{}, from '{}'", name, info.dataset().c_str(), info.frames(),
               traversal->names.empty() ? "" : ", the same as " + traversal->name(), info.header().sender().c_str());
  traversal->names.insert(name);
  const bool learns = encoder_->training_sample_count() > 0 || (needs_reference() && options_.reduction_file.empty());
  if (name != options_.reference || traversal->is_live || !learns) return;
  for (const auto& [hash, other] : traversals_)
    if (hash != info.hash() && !other->is_live && other->names.contains(name))
      node_.alarm("reference", fmt::format("'{}' hosts other frames of the reference '{}' than those known before: "
                                           "features may be made by either. Host one, and restart encoder_services",
                                           info.header().sender().c_str(), name));
}

const EncodedTraversal* EncodingPipeline::find(std::uint64_t hash) const {
  const auto found = traversals_.find(hash);
  return found == traversals_.end() ? nullptr : found->second.get();
}

void EncodingPipeline::on_positions(const msg::TraversalChunk& chunk) {
  const auto found = traversals_.find(chunk.hash());
  if (found == traversals_.end() || chunk.part() != 0) return;
  if (found->second->positions.take(chunk) == Taken::kDamaged) ++node_.traffic.rejected;
}

void EncodingPipeline::on_image(const msg::ImageChunk& chunk) {
  const auto found = traversals_.find(chunk.hash());
  if (found == traversals_.end()) return;
  EncodedTraversal& traversal = *found->second;
  if (traversal.images.take(chunk, Clock::now()) == Taken::kDamaged) ++node_.traffic.rejected;
  while (const auto object = traversal.images.next()) {
    const int frame = static_cast<int>(object->item);
    try {
      FetchedImage image{frame, fmt::format("frame {}: there is none", frame), {}};
      if (!object->bytes.empty()) {
        const auto sent = decode_object<msg::Image>(object->bytes);
        const auto file = std::as_bytes(std::span(sent.file()));
        image = {frame, sent.name().c_str(), Bytes(file.begin(), file.end())};
      }
      traversal.bytes += image.file.size();
      (encoder_ready_ ? traversal.waiting : training_sample_).push_back(std::move(image));
    } catch (const Error&) {
      ++node_.traffic.rejected;
      traversal.images.refuse(object->item);
    }
  }
}

void EncodingPipeline::advance(Clock::time_point now) {
  now_ = now;
  encoding_.run_completions();
  reducing_.run_completions();
  if (!encoder_ready_) {
    learn_encoder();
    finish_training_sample();
  }
  if (encoder_ready_) {
    if (!reduction_ && !options_.reduction_file.empty()) {
      const std::string bytes = read_file(options_.reduction_file);
      reduction_ = std::make_shared<Reduction>(
          Reduction::load(std::as_bytes(std::span(bytes)), spec_.name, options_.reduction_file));
      reduction_source_ = mix_text(bytes);
    }
    encode_traversals();
    reduce_traversals();
  }
  exchange_.advance(now);
  send_requests();
}

EncodedTraversal* EncodingPipeline::reference() const {
  EncodedTraversal* encoded = nullptr;  // whose env_service may be gone
  for (const auto& [hash, traversal] : traversals_) {
    if (traversal->is_live || !traversal->names.contains(options_.reference)) continue;
    if (!find_host_(hash, options_.reference).empty()) return traversal.get();
    if (traversal->work && traversal->work->complete()) encoded = traversal.get();
  }
  return encoded;
}

/// Returns where the store has what the encoder learned on the traversal with this hash.
std::string EncodingPipeline::encoder_path(std::uint64_t traversal) const {
  return learned_path(options_.store, fmt::format("{} {:016x}", encoder_recipe_, traversal), "encoder");
}

FeatureRecipe EncodingPipeline::feature_recipe() const {
  if (!options_.reduction_file.empty())
    return {spec_.name, std::filesystem::path(options_.reduction_file).filename(), reduction_source_};
  const EncodedTraversal* teacher = reduction_ || !needs_reference() ? nullptr : reference();
  return {spec_.name, recipe_of(options_.reduction), teacher ? teacher->hash : reduction_source_};
}

// ---------------------------------------------------------------- The encoder learns from the reference traversal.

void EncodingPipeline::learn_encoder() {
  EncodedTraversal* traversal = reference();
  if (sampling_ || !traversal) return;
  if (restore_encoder(encoder_path(traversal->hash))) return;
  sampling_ = true;
  const std::vector<int> frames = training_frames(encoder_->training_sample_count(), traversal->frames);
  spdlog::info("encoder {} learns from {} of {} frames of {}", options_.encoder, frames.size(), traversal->frames,
               traversal->name());
  for (const int frame : frames) traversal->images.want(static_cast<std::uint64_t>(frame));
}

/// Restores what the encoder learned before. Returns false when that is not there or damaged.
bool EncodingPipeline::restore_encoder(const std::string& path) {
  if (options_.store.empty() || !std::filesystem::exists(path)) return false;
  const std::string state = read_file(path);
  try {
    encoder_->restore(std::as_bytes(std::span(state)));
  } catch (const Error& error) {
    spdlog::warn("{}: {}; learning anew", path, error.what());
    return false;
  }
  encoder_ready_ = true;
  spec_ = encoder_->spec();
  spdlog::info("encoder {}: {} numbers a picture, learned before ({})", spec_.name, spec_.dimension, path);
  return true;
}

void EncodingPipeline::finish_training_sample() {
  EncodedTraversal* traversal = reference();
  if (!sampling_ || encoder_ready_ || !traversal || traversal->images.missing() > 0 || training_sample_.empty()) return;
  // Two encoder_services learn the same only if they see the same in the same order; pictures arrive in any.
  std::sort(training_sample_.begin(), training_sample_.end(),
            [](const FetchedImage& a, const FetchedImage& b) { return a.frame < b.frame; });
  auto images = std::make_shared<std::vector<FetchedImage>>(std::move(training_sample_));
  training_sample_.clear();
  traversal->bytes = 0;
  const std::uint64_t hash = traversal->hash;
  encoding_.post(
      [this, images] {
        std::vector<cv::Mat> pictures;
        for (const DecodedImage& image : decode(*images))
          if (image.fault.empty())
            pictures.push_back(image.picture);
          else
            spdlog::warn("{}", image.fault);
        if (pictures.empty()) throw Error("no picture can be read", "reference '" + options_.reference + "'");
        encoder_->learn(pictures);
      },
      [this, hash] {
        encoder_ready_ = true;
        spec_ = encoder_->spec();
        spdlog::info("encoder {}: {} numbers a picture", spec_.name, spec_.dimension);
        if (options_.store.empty()) return;
        write_file(encoder_path(hash), as_text(encoder_->state()));
      });
}

// ---------------------------------------------------------------- Images are fetched and encoded.

void EncodingPipeline::encode_traversals() {
  std::vector<EncodedTraversal*> order;
  for (const auto& [hash, traversal] : traversals_)
    if (traversal->is_live)
      traversal->ready ? encode(*traversal, true) : begin_live(*traversal);
    else if (!traversal->ready && !traversal->reducing && traversal->fault.empty() && has_host(*traversal))
      order.push_back(traversal.get());
    else if (traversal->work)  // others may go on
      forget(*traversal, traversal->work->give_back());
  // The others wait for the reference.
  std::stable_partition(order.begin(), order.end(),
                        [first = reference()](const EncodedTraversal* traversal) { return traversal == first; });
  int ahead = 0;
  for (EncodedTraversal* traversal : order)
    ahead += static_cast<int>(traversal->images.missing() + traversal->waiting.size()) + traversal->in_background;
  for (EncodedTraversal* traversal : order) {
    if (!traversal->work) {
      FeatureStore::Key key{spec_.name, spec_.dimension, traversal->hash, traversal->frames};
      BlockDivision& division = exchange_.division(traversal->hash, static_cast<std::uint32_t>(traversal->frames));
      traversal->work = std::make_unique<TraversalWork>(options_.store, key, division);
      exchange_.share(*traversal->work);
      traversal->since = now_;
      traversal->next_progress = now_ + kProgressInterval;
      if (traversal->work->done() > 0)
        spdlog::info("{}: {} of {} frames were encoded before", traversal->name(), traversal->work->done(),
                     traversal->frames);
    }
    divide_work(*traversal, ahead);
    encode(*traversal, traversal->images.missing() == 0);
    if (now_ < traversal->next_progress || traversal->work->complete()) continue;
    traversal->next_progress = now_ + kProgressInterval;
    if (!traversal->time_left(now_).empty())
      spdlog::info("{}: {} of {} frames encoded, {} left", traversal->name(), traversal->work->done(),
                   traversal->frames, traversal->time_left(now_));
  }
}

/// Begins blocks, and asks for their images. `ahead`: frames on their way.
void EncodingPipeline::divide_work(EncodedTraversal& traversal, int& ahead) {
  TraversalWork& work = *traversal.work;
  forget(traversal, work.take_lost());
  // Enough images are on their way that neither the wire nor the processor waits for the other.
  while (!work.complete() && exchange_.settled(now_) && ahead < BlockDivision::kFrames + 2 * spec_.batch) {
    const std::vector<int> frames = work.begin(now_);
    if (frames.empty()) break;
    ahead += static_cast<int>(frames.size());
    for (const int frame : frames) traversal.images.want(static_cast<std::uint64_t>(frame));
  }
}

/// Drops images of frames that this service need not encode any more, unless they are being encoded.
void EncodingPipeline::forget(EncodedTraversal& traversal, const std::vector<int>& frames) {
  if (frames.empty()) return;
  for (const int frame : frames) traversal.images.drop(static_cast<std::uint64_t>(frame));
  std::erase_if(traversal.waiting, [&](const FetchedImage& image) {
    const bool dropped = std::find(frames.begin(), frames.end(), image.frame) != frames.end();
    if (dropped) traversal.bytes -= image.file.size();
    return dropped;
  });
}

void EncodingPipeline::encode(EncodedTraversal& traversal, bool incomplete_batches) {
  std::vector<FetchedImage>& waiting = traversal.waiting;
  while (!waiting.empty() && (incomplete_batches || static_cast<int>(waiting.size()) >= spec_.batch)) {
    auto batch = std::make_shared<Batch>();
    const auto count = std::min<std::ptrdiff_t>(spec_.batch, static_cast<std::ptrdiff_t>(waiting.size()));
    std::move(waiting.begin(), waiting.begin() + count, std::back_inserter(batch->images));
    waiting.erase(waiting.begin(), waiting.begin() + count);
    traversal.in_background += static_cast<int>(count);
    encoding_.post(
        [this, batch] {
          std::vector<cv::Mat> pictures;
          for (const DecodedImage& image : decode(batch->images))
            if (image.fault.empty()) {
              pictures.push_back(image.picture);
              batch->frames.push_back(image.frame);
            } else {
              batch->faults.emplace_back(image.frame, image.fault);
            }
          if (!pictures.empty()) batch->descriptors = encoder_->encode(pictures);
        },
        [this, batch, &traversal] { store_batch(*batch, traversal); });
  }
}

void EncodingPipeline::store_batch(const Batch& batch, EncodedTraversal& traversal) {
  traversal.in_background -= static_cast<int>(batch.images.size());
  for (const FetchedImage& image : batch.images) traversal.bytes -= image.file.size();
  if (traversal.is_live) {
    for (std::size_t i = 0; i < batch.frames.size(); ++i)
      traversal.live->put(batch.frames[i], batch.descriptors.col(static_cast<Eigen::Index>(i)));
    for (const auto& [frame, reason] : batch.faults) {
      spdlog::warn("{}, frame {}: {}; the one before it takes its place", traversal.name(), frame, reason);
      traversal.live->put_bad(frame);
    }
    for (const FetchedImage& image : batch.images) traversal.asked.erase(image.frame);
    encoded_ += batch.frames.size();
    return;
  }
  for (std::size_t i = 0; i < batch.frames.size(); ++i)
    traversal.work->put(batch.frames[i], batch.descriptors.col(static_cast<Eigen::Index>(i)));
  encoded_ += batch.frames.size();
  for (const auto& [frame, reason] : batch.faults) {
    spdlog::error("{}, frame {}: {}", traversal.name(), frame, reason);
    traversal.work->put_bad(frame);
    if (!options_.skip_bad_frames && traversal.fault.empty())
      traversal.fault = fmt::format("{} is refused: frame {}: {} (--on-bad-frame skip puts its neighbour in its place)",
                                    traversal.name(), frame, reason);
  }
  if (!traversal.fault.empty()) spdlog::error("{}", traversal.fault);
}

// ---------------------------------------------------------------- A robot's pictures are encoded as they come.

/// Gets ready for the pictures of a robot, once what the reference teaches is known.
void EncodingPipeline::begin_live(EncodedTraversal& traversal) {
  if (!traversal.fault.empty() || (needs_reference() && !reduction_)) return;
  try {
    traversal.live = std::make_unique<LiveFeatures>(options_.reduction, reduction_, spec_.dimension);
  } catch (const Error& error) {
    traversal.fault = fmt::format("{} is refused: {}", traversal.name(), error.what());
    spdlog::error("{}", traversal.fault);
    return;
  }
  traversal.ready = true;
  spdlog::info("{}: ready, {} features for each picture of the robot", traversal.name(), traversal.dimension());
}

void EncodingPipeline::want(std::uint64_t hash, std::span<const std::uint32_t> frames) {
  EncodedTraversal& traversal = *traversals_.at(hash);
  for (const std::uint32_t frame : frames)
    if (!traversal.find(frame) && traversal.asked.insert(static_cast<int>(frame)).second) traversal.images.want(frame);
}

// ---------------------------------------------------------------- Descriptors are reduced to features.

void EncodingPipeline::reduce_traversals() {
  for (const auto& [hash, traversal] : traversals_)
    if (traversal->work && !traversal->reducing && !traversal->ready && traversal->fault.empty() &&
        traversal->work->complete())
      reduce(*traversal);
}

void EncodingPipeline::reduce(EncodedTraversal& traversal) {
  if (needs_reference() && !reduction_ && &traversal != reference()) return;  // the reference goes first
  if (!traversal.positions.complete()) return;
  traversal.reducing = true;
  spdlog::info("{}: all {} frames encoded ({} of them now, {} by others, in {:.1f} s)", traversal.name(),
               traversal.frames, traversal.work->made(), traversal.work->fetched(),
               std::chrono::duration<double>(now_ - traversal.since).count());
  auto reduced = std::make_shared<ReducedTraversal>();
  ReductionOptions reduction = options_.reduction;
  const int most = Reduction::largest_dimension(spec_.dimension, traversal.frames);
  if (options_.cap_dimension && !reduction_ && reduction.dimension > most) {
    spdlog::info("reference '{}' has {} frames of {} numbers: --dimension is {} instead of {}", traversal.name(),
                 traversal.frames, spec_.dimension, most, reduction.dimension);
    reduction.dimension = most;
  }
  const std::string path = options_.store.empty() || !needs_reference()
                               ? ""
                               : reduction_path(options_.store, spec_.name, traversal.hash, reduction);
  const TraversalWork* work = traversal.work.get();
  reducing_.post(
      [this, work, reduced, source = ReductionSource{reduction_, reduction, path}] {
        *reduced = reduce_traversal(*work, source, options_.store);
      },
      [this, &traversal, reduced] {
        traversal.reducing = false;
        if (!reduced->lost.empty()) {
          spdlog::warn("{}: the store has lost {} frames; they are encoded again", traversal.name(),
                       reduced->lost.size());
          traversal.work->lose(reduced->lost);
          return;
        }
        if (needs_reference() && !reduction_) {
          reduction_ = reduced->reduction;
          reduction_source_ = traversal.hash;
        }
        traversal.features = std::move(reduced->features);
        traversal.ready = true;
        spdlog::info("{}: ready, {} features a frame", traversal.name(), traversal.features.rows());
      });
}

void EncodingPipeline::send_requests() {
  for (const auto& [hash, traversal] : traversals_) {
    const std::string host = find_host_(hash, "");
    if (host.empty() || (traversal->ready && !traversal->is_live)) continue;
    image_request_.server() = host.c_str();
    if ((!encoder_ready_ || traversal->bytes < kMaxBacklogBytes) && traversal->images.ask(Clock::now(), image_request_))
      node_.publish(image_request_);
    if (traversal->is_live || !traversal->positions.ask(now_, request_)) continue;
    request_.server() = host.c_str();
    node_.publish(request_);
  }
}

bool EncodingPipeline::busy() const {
  return std::any_of(traversals_.begin(), traversals_.end(), [](const auto& entry) {
    const EncodedTraversal& traversal = *entry.second;
    return traversal.fault.empty() && (!traversal.ready || !traversal.asked.empty());
  });
}

std::optional<std::pair<msg::State, std::string>> EncodingPipeline::status(Clock::time_point now) const {
  std::optional<std::pair<msg::State, std::string>> first;
  for (const auto& [hash, traversal] : traversals_) {
    if (!traversal->fault.empty()) return std::pair{msg::FAILED, traversal->fault};
    if (first || traversal->ready || !has_host(*traversal)) continue;
    const bool encoded = traversal->work && traversal->work->complete();
    if (traversal->work && !(encoded && needs_reference() && !reduction_ && !reference())) {
      const std::string left = traversal->time_left(now);
      first.emplace(msg::RUNNING,
                    fmt::format("{}: {} of {} frames encoded{}", traversal->name(), traversal->work->done(),
                                traversal->frames, left.empty() ? "" : ", " + left + " left"));
    } else if (!traversal->work && sampling_) {
      first.emplace(msg::RUNNING, "learning from " + options_.reference);
    } else {
      first.emplace(msg::WAITING, fmt::format("{} waits for an env_service on the reference '{}'", traversal->name(),
                                              options_.reference));
    }
  }
  return first;
}

}  // namespace citylearn
