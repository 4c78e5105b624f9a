// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal_server.h"

#include <spdlog/spdlog.h>

#include "core/util/error.h"
#include "core/util/name.h"
#include "core/wire/streets.h"
#include "core/wire/transfer.h"

namespace citylearn {

TraversalServer::TraversalServer(Node& node, const Environment& environment)
    : node_(node),
      environment_(environment),
      traversal_(environment.traversal()),
      streets_hash_(traversal_.streets ? traversal_.streets->hash() : 0),
      frames_(
          [this](const ObjectKey& key) {
            return traversal_object(key, traversal_.positions, [this](std::uint32_t frame) {
              return environment_.feature(static_cast<int>(frame));
            });
          },
          node.traffic.rejected),
      images_([this](const ObjectKey& key) { return image(key); }, node.traffic.rejected),
      maps_([this](const ObjectKey& key) { return map(key); }, node.traffic.rejected),
      streets_([this](const ObjectKey& key) { return streets(key); }, node.traffic.rejected) {
  node_.create_reader<msg::TraversalRequest>();
  node_.create_reader<msg::RouteMapRequest>();
  if (traversal_.streets) node_.create_reader<msg::StreetsRequest>();
  if (traversal_.images) node_.create_reader<msg::ImageRequest>();
}

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
  info.frames() = static_cast<std::uint32_t>(traversal_.frames);
  info.feature_dimension() = static_cast<std::uint32_t>(traversal_.dimension);
  info.agents() = static_cast<std::uint32_t>(environment_.agents());
  if (traversal_.streets) {
    info.rule() = static_cast<msg::StateRule>(traversal_.rule);
    info.places() = static_cast<std::uint32_t>(traversal_.streets->places());
    info.links() = static_cast<std::uint32_t>(traversal_.streets->links());
    info.streets_hash() = streets_hash_;
  }
  info.images() = traversal_.images != nullptr;
  return info;
}

bool TraversalServer::take_requests() {
  bool frames = false;
  while (node_.take(request_))
    if (addressed(request_.server().c_str(), request_.hash()) &&
        (request_.part() == static_cast<std::uint32_t>(traversal_.dimension) ||
         (request_.part() == 0 && traversal_.images))) {
      frames_.note(request_);
      frames = true;
    }
  while (node_.take(map_request_))
    if (addressed(map_request_.server().c_str(), map_request_.hash())) maps_.note(map_request_);
  while (traversal_.streets && node_.take(streets_request_))
    if (streets_request_.server().c_str() == node_.options().id && streets_request_.hash() == streets_hash_)
      streets_.note(streets_request_);
  while (traversal_.images && node_.take(image_request_))
    if (addressed(image_request_.server().c_str(), image_request_.hash())) images_.note(image_request_);
  return frames;
}

bool TraversalServer::send_objects() {
  bool more = frames_.send(chunk_, [this] { node_.publish(chunk_); });
  more |= maps_.send(map_chunk_, [this] { node_.publish(map_chunk_); });
  more |= streets_.send(streets_chunk_, [this] { node_.publish(streets_chunk_); });
  return images_.send(image_chunk_, [this] { node_.publish(image_chunk_); }) || more;
}

/// Returns the Image of a frame, or nothing where there is no such frame.
std::shared_ptr<const ObjectBytes> TraversalServer::image(const ObjectKey& key) {
  const std::uint64_t frame = key.item;
  if (frame >= static_cast<std::uint64_t>(traversal_.images->frames())) {
    ++node_.traffic.rejected;
    return {};
  }
  msg::Image image;
  std::string name = traversal_.images->name(static_cast<int>(frame));
  try {
    traversal_.images->read(static_cast<int>(frame), file_);
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(file_.data());
    image.file().assign(bytes, bytes + file_.size());
  } catch (const Error& error) {
    name = error.what();
    spdlog::error("frame {}: {}", frame, name);
  }
  image.name() = name.substr(0, 200).c_str();
  return std::make_shared<ObjectBytes>(key, encode_object(image));
}

std::shared_ptr<const ObjectBytes> TraversalServer::map(const ObjectKey& key) const {
  msg::RouteMap map;
  map.position() = traversal_.positions;
  map.latitude() = traversal_.latitude;
  map.longitude() = traversal_.longitude;
  return std::make_shared<ObjectBytes>(key, encode_object(map));
}

std::shared_ptr<const ObjectBytes> TraversalServer::streets(const ObjectKey& key) const {
  return std::make_shared<ObjectBytes>(key, encode_streets(*traversal_.streets));
}

}  // namespace citylearn
