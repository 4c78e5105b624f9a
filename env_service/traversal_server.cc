// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal_server.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include "core/exchange/timing.h"
#include "core/util/error.h"
#include "core/util/name.h"
#include "core/wire/blob.h"
#include "core/wire/transfer.h"

namespace citylearn {
namespace {

constexpr std::uint32_t kAllChunks = std::numeric_limits<std::uint32_t>::max();  // all chunks

}  // namespace

TraversalServer::TraversalServer(Node& node, const Environment& environment)
    : node_(node),
      environment_(environment),
      traversal_(environment.traversal()),
      frames_(static_cast<std::uint32_t>(traversal_.frames)) {}

msg::TraversalInfo TraversalServer::info() const {
  if (const std::string problem = name_problem(traversal_.name); !problem.empty())
    throw Error(problem, "name of the traversal");
  if (traversal_.condition.size() > kMaxNameLength)
    throw Error("has more than " + std::to_string(kMaxNameLength) + " characters: " + traversal_.condition,
                "condition of the traversal");
  msg::TraversalInfo info;
  info.dataset() = traversal_.dataset.c_str();
  info.traversal() = traversal_.name.c_str();
  info.condition() = traversal_.condition.c_str();
  info.hash() = environment_.traversal_hash();
  info.frames() = frames_;
  info.feature_dimension() = static_cast<std::uint32_t>(traversal_.dimension);
  info.agents() = static_cast<std::uint32_t>(environment_.agents());
  info.chunks() = ChunkLayout(frames_, info.feature_dimension()).chunks();
  info.images() = traversal_.images != nullptr;
  return info;
}

bool TraversalServer::can_answer(const msg::TraversalRequest& request) const {
  const std::uint32_t dimension = request.feature_dimension();
  return addressed(request) &&
         (dimension == static_cast<std::uint32_t>(traversal_.dimension) || (dimension == 0 && traversal_.images));
}

void TraversalServer::answer(const msg::TraversalRequest& request) {
  const ChunkLayout layout(frames_, request.feature_dimension());
  for (const std::uint32_t index : request.chunks()) {
    if (index >= layout.chunks()) {
      ++node_.traffic.rejected;
      continue;
    }
    chunk_.receiver() = request.header().sender();
    chunk_.hash() = environment_.traversal_hash();
    layout.fill(
        index, traversal_.positions,
        [this](std::uint32_t frame) { return environment_.feature(static_cast<int>(frame)); }, chunk_);
    node_.publish(chunk_);
  }
}

/// Reads the frame's file into image_, unless it is there. `name` becomes the reason when it cannot be read.
void TraversalServer::read_image(std::uint32_t frame, std::string& name) {
  name = traversal_.images->name(static_cast<int>(frame));
  if (image_frame_ == static_cast<int>(frame)) return;
  image_frame_ = static_cast<int>(frame);
  try {
    traversal_.images->read(image_frame_, image_);
  } catch (const Error& error) {
    name = error.what();
    spdlog::error("frame {}: {}", frame, name);
    image_.clear();
    image_frame_ = -1;
  }
}

void TraversalServer::note(const msg::ImageRequest& request) {
  if (!addressed(request)) return;
  std::erase_if(sent_, [now = Clock::now()](const auto& sent) { return now > sent.second.at + kObjectCrossing; });
  const std::string service = request.header().sender().c_str();
  PictureOrder& order = orders_[service];
  std::uint32_t first_chunk = request.first_chunk();
  bool more = false;
  for (const std::uint32_t frame : request.frames()) {
    if (order.pictures.size() == msg::MAX_FRAMES_ASKED) break;
    WantedPicture wanted{frame, std::exchange(first_chunk, 0)};
    if (frame >= static_cast<std::uint32_t>(traversal_.images->frames())) {
      ++node_.traffic.rejected;
      continue;
    }
    if (const auto sent = sent_.find({service, frame}); sent != sent_.end())
      wanted.first_chunk = std::max(wanted.first_chunk, sent->second.next_chunk);
    if (wanted.first_chunk == kAllChunks ||
        std::any_of(order.pictures.begin(), order.pictures.end(),
                    [&](const WantedPicture& other) { return other.frame == frame; }))
      continue;
    order.pictures.push_back(wanted);
    more = true;
  }
  if (more) order.most_chunks += msg::MAX_CHUNKS_ASKED;
}

bool TraversalServer::send_pictures() {
  for (auto& [service, order] : orders_)
    if (!order.pictures.empty()) send_picture(service, order);
  std::erase_if(orders_, [](const auto& order) { return order.second.pictures.empty(); });
  return !orders_.empty();
}

/// Sends the first picture of an order, or as many of its chunks as are expected; the service then asks for the rest.
void TraversalServer::send_picture(const std::string& service, PictureOrder& order) {
  const WantedPicture wanted = order.pictures.front();
  order.pictures.pop_front();
  std::string name;
  read_image(wanted.frame, name);
  image_chunk_.receiver() = service.c_str();
  image_chunk_.hash() = environment_.traversal_hash();
  image_chunk_.frame() = wanted.frame;
  image_chunk_.name() = name.substr(0, 200).c_str();
  image_chunk_.total_bytes() = static_cast<std::uint32_t>(image_.size());
  const std::uint32_t chunks = chunk_count(image_.size());
  const std::uint32_t first = std::min(wanted.first_chunk, chunks);
  const std::uint32_t end = first + std::min(chunks - first, order.most_chunks);
  for (std::uint32_t chunk = first; chunk < end; ++chunk) {
    const auto data = chunk_of(std::span<const std::byte>(image_), chunk);
    image_chunk_.chunk() = chunk;
    image_chunk_.data().resize(data.size());
    if (!data.empty()) std::memcpy(image_chunk_.data().data(), data.data(), data.size());
    node_.publish(image_chunk_);
  }
  sent_[{service, wanted.frame}] = {Clock::now(), end == chunks ? kAllChunks : end};
  order.most_chunks -= end - first;
  if (end < chunks || order.most_chunks == 0) order.pictures.clear();
}

void TraversalServer::answer(const msg::MapRequest& request) {
  if (!addressed(request)) return;
  if (request.first() >= frames_) {
    ++node_.traffic.rejected;
    return;
  }
  map_chunk_.receiver() = request.header().sender();
  map_chunk_.hash() = environment_.traversal_hash();
  map_chunk_.frames() = frames_;
  map_chunk_.first() = request.first();
  const std::size_t count = std::min<std::size_t>(frames_ - request.first(), msg::MAX_PLACES);
  const auto copy = [&](const auto& from, auto& to) {
    to.clear();
    if (from.empty()) return;
    const auto begin = from.begin() + static_cast<std::ptrdiff_t>(request.first());
    to.assign(begin, begin + static_cast<std::ptrdiff_t>(count));
  };
  copy(traversal_.positions, map_chunk_.position());
  copy(traversal_.latitude, map_chunk_.latitude());
  copy(traversal_.longitude, map_chunk_.longitude());
  node_.publish(map_chunk_);
}

}  // namespace citylearn
