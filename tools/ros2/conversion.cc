// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/conversion.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>

#include "core/recording/mcap.h"
#include "core/recording/wire_header.h"
#include "core/util/error.h"
#include "core/wire/blob.h"
#include "dashboard/live/picture_shrink.h"

namespace citylearn {
namespace {

/// The maps and pictures of recordings.
class Store {
 public:
  explicit Store(int widest) : widest_(widest) {}

  void add(const msg::MapChunk& chunk) {
    std::shared_ptr<RouteMap>& map = maps_[chunk.hash()];
    if (!map) map = std::make_shared<RouteMap>();
    map->frames = chunk.frames();
    put(chunk.position(), chunk.first(), map->frames, map->position);
    if (chunk.latitude().empty()) return;
    put(chunk.latitude(), chunk.first(), map->frames, map->latitude);
    put(chunk.longitude(), chunk.first(), map->frames, map->longitude);
  }
  void add(const msg::ImageChunk& chunk) {
    const PictureKey key{chunk.hash(), chunk.frame()};
    if (chunk.total_bytes() == 0 || pictures_.contains(key)) return;
    Blob& file = files_.try_emplace(key, chunk.total_bytes()).first->second;
    file.take(chunk.chunk(), chunk.data());
    if (!file.complete()) return;
    try {
      pictures_[key] = std::make_shared<PictureFile>(shrink(file.release(), {widest_}, chunk.name().c_str()));
    } catch (const Error& error) {
      spdlog::warn("{}", error.what());
      pictures_[key] = nullptr;
    }
    files_.erase(key);
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
  template <class Number>
  static void put(const std::vector<Number>& part, std::uint32_t first, std::uint32_t frames,
                  std::vector<Number>& all) {
    all.resize(frames, std::numeric_limits<Number>::quiet_NaN());
    if (first >= frames) return;
    std::copy_n(part.begin(), std::min<std::size_t>(part.size(), frames - first), all.begin() + first);
  }

  const int widest_;
  std::map<std::uint64_t, std::shared_ptr<RouteMap>> maps_;
  std::map<PictureKey, Blob> files_;
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
    const auto missing = read<msg::MapChunk, msg::ImageChunk>(
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
