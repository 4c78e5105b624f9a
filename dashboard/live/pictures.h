// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/wire/blob.h"
#include "core/wire/node.h"
#include "dashboard/live/picture_cache.h"

namespace citylearn {

/// The pictures of frames, fetched from env_services when somebody wants to see them: small enough for a page, and kept
/// for a while. find() may be used by any thread, all else by the one of the node.
class Pictures {
 public:
  struct Options {
    std::size_t most_bytes = std::size_t{64} << 20;  ///< kept
    int widest = 640;                                ///< pixels
    std::chrono::milliseconds between{100};          ///< pictures asked for
    std::chrono::milliseconds patience{500};         ///< until what did not come is asked for again
    std::size_t most_wanted = 64;                    ///< beyond, the oldest are forgotten
  };
  struct Source {
    std::string run, environment;
  };
  Pictures(Node& node, const Options& options);
  ~Pictures();

  std::shared_ptr<const PictureFile> find(const PictureKey& key) { return cache_.find(key); }

  /// To be fetched: the newest and the oldest by turns. What is under way is not asked for twice.
  void want(const PictureKey& key, const Source& source);
  /// Takes what has come and asks for what is due.
  void turn(Clock::time_point now);
  /// Of the next request, or time_point::max().
  Clock::time_point due() const;
  /// It will be here, unless it does not come.
  bool coming(const PictureKey& key);

 private:
  struct Fetch {
    Source source;
    RequestTimer timer;
    std::optional<Blob> file = {};  // once a chunk has come
  };
  void hear(const msg::ImageChunk& chunk, Clock::time_point now);
  void ask(const PictureKey& key, Fetch& fetch, Clock::time_point now);
  void hand_over(const PictureKey& key, Bytes file, const std::string& name);
  void work();

  Node& node_;
  const Options options_;
  PictureCache cache_;
  std::deque<std::pair<PictureKey, Source>> wanted_;  // not asked for yet; the newest last
  std::map<PictureKey, Fetch> fetches_;
  Clock::time_point next_{};
  bool newest_next_ = false, listens_ = false;
  msg::ImageChunk chunk_;

  // The thread that makes them small.
  struct Work {
    PictureKey key;
    Bytes file;
    std::string name;
  };
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Work> work_;  // the first one is being done
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace citylearn
