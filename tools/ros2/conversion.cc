// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/conversion.h"

#include <spdlog/spdlog.h>

#include <optional>
#include <span>

#include "core/exchange/object_fetch.h"
#include "core/recording/mcap.h"
#include "core/recording/wire_header.h"
#include "core/util/error.h"
#include "dashboard/live/picture_shrink.h"

namespace citylearn {
namespace {

/// The maps and pictures of recordings.
class Store {
 public:
  explicit Store(int widest) : widest_(widest) {}

  void add(const msg::RouteMapChunk& chunk) {
    const auto map = joined<msg::RouteMap>(chunk, chunk.hash(), map_chunks_);
    if (!map) return;
    maps_[chunk.hash()] = std::make_shared<RouteMap>(RouteMap{static_cast<std::uint32_t>(map->position().size()),
                                                              map->position(), map->latitude(), map->longitude()});
  }
  void add(const msg::ImageChunk& chunk) {
    const PictureKey key{chunk.hash(), static_cast<std::uint32_t>(chunk.item())};
    const auto image = joined<msg::Image>(chunk, key, image_chunks_);
    if (!image || image->file().empty()) return;
    const auto file = std::as_bytes(std::span(image->file()));
    try {
      pictures_[key] =
          std::make_shared<PictureFile>(shrink(Bytes(file.begin(), file.end()), {widest_}, image->name().c_str()));
    } catch (const Error& error) {
      spdlog::warn("{}", error.what());
      pictures_[key] = nullptr;
    }
  }
  std::shared_ptr<const RouteMap> map(std::uint64_t hash) const {
    const auto found = maps_.find(hash);
    return found == maps_.end() ? nullptr : found->second;
  }
  std::shared_ptr<const PictureFile> picture(const PictureKey& key) const {
    const auto found = pictures_.find(key);
    return found == pictures_.end() ? nullptr : found->second;
  }

 private:
  /// Returns the object whose last missing chunk this is.
  template <class Object, class Key>
  static std::optional<Object> joined(const msg::ObjectChunk& chunk, const Key& key, std::map<Key, ObjectFetch>& all) {
    if (chunk.total_bytes() == 0) return std::nullopt;
    const auto [found, fresh] = all.try_emplace(key, FetchOptions{.hash = chunk.hash()});
    if (fresh) found->second.want(chunk.item());
    found->second.take(chunk, {});
    const auto object = found->second.next();
    if (!object) return std::nullopt;
    try {
      return decode_object<Object>(object->bytes);
    } catch (const Error& error) {
      spdlog::warn("{}", error.what());
      return std::nullopt;
    }
  }

  const int widest_;
  std::map<std::uint64_t, std::shared_ptr<RouteMap>> maps_;
  std::map<PictureKey, ObjectFetch> image_chunks_;
  std::map<std::uint64_t, ObjectFetch> map_chunks_;
  std::map<PictureKey, std::shared_ptr<const PictureFile>> pictures_;
};

/// Calls `use(message, time)` for all messages of these types. Returns what the files lack, a line each.
template <class... Messages, class Use>
std::vector<std::string> read(const Ros2Conversion& conversion, std::uint64_t& unreadable, Use use) {
  std::vector<std::string> missing;
  for (const std::string& file : conversion.files) {
    McapReader reader(file);
    while (const auto read = reader.next()) {
      if (!conversion.session.empty()) {
        const auto header = header_of(read->data);
        if (!header || header->session != conversion.session) continue;
      }
      const auto decode_if = [&]<class Message>(Message message) {
        if (read->channel->topic != topic_of<Message>().name) return;
        try {
          decode(read->data, message);
        } catch (const Error& error) {
          if (++unreadable == 1) spdlog::warn("{}: {}", file, error.what());
          return;
        }
        use(message, read->log_time);
      };
      (decode_if(Messages()), ...);
    }
    if (!reader.missing().empty()) missing.push_back(file + ": " + reader.missing());
  }
  return missing;
}

}  // namespace

Ros2ConversionResult convert(const Ros2Conversion& conversion, Ros2Sink& sink) {
  Ros2ConversionResult result;
  Store store(conversion.widest);
  try {
    const auto missing = read<msg::RouteMapChunk, msg::ImageChunk>(
        conversion, result.unreadable, [&](const auto& chunk, std::uint64_t) { store.add(chunk); });
    for (const std::string& line : missing) spdlog::warn("{}", line);
  } catch (const Error&) {  // the second pass comes to the same damage, after all that stands before it
  }
  Ros2Translation translation(sink, conversion.translation,
                              {[&](const std::string&, std::uint64_t hash) { return store.map(hash); },
                               [&](const std::string&, const PictureKey& key, bool&) { return store.picture(key); }});
  read<msg::Observation, msg::Scene, msg::Action, msg::EpisodeStat, msg::TrainingStat>(
      conversion, result.unreadable,
      [&](const auto& message, std::uint64_t time) { translation.on_message(message, time); });
  result.pictures = translation.pictures();
  result.missing_pictures = translation.missing_pictures();
  return result;
}

}  // namespace citylearn
