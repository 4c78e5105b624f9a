// SPDX-License-Identifier: Apache-2.0
#include "tools/record/recording.h"

#include <algorithm>
#include <chrono>
#include <filesystem>

#include "core/recording/idl_text.h"
#include "core/util/error.h"
#include "core/wire/messages.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kFlushAfter = 1'000'000'000;  // nanoseconds
constexpr int kAtOnce = 256;                          // of a topic, before the others

std::uint64_t now_nanoseconds() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

std::string name_of(Profile profile) {
  switch (profile) {
    case Profile::kStream:
      return "stream";
    case Profile::kState:
      return "state";
    case Profile::kCommand:
      return "command";
    case Profile::kDurable:
      return "durable";
  }
  return "";
}

}  // namespace

Recording::Recording(Middleware& middleware, const RecordingOptions& options) : options_(options) {
  std::set<std::string> wanted;
  for (const std::string& given : options_.topics)
    wanted.insert(given.starts_with("citylearn/") ? given : "citylearn/" + given);
  for (const Topic& topic : all_topics())
    if (options_.topics.empty() || wanted.erase(topic.name) > 0) sources_.push_back({topic, nullptr});
  if (!wanted.empty()) throw Error("unknown topic", "--topics " + *wanted.begin(), "idl/ lists them");
  begin_file();
  for (Source& source : sources_) source.subscription = middleware.create_subscription(source.topic);
}

void Recording::begin_file() {
  std::filesystem::path path = options_.output;
  if (!files_.empty())
    path.replace_filename(path.stem().string() + "-" + std::to_string(files_.size() + 1) + path.extension().string());
  McapWriter::Options options;
  options.library = options_.library;
  options.about = {{"session", options_.session}, {"part", std::to_string(files_.size() + 1)}};
  writer_ = std::make_unique<McapWriter>(path, options);
  files_.push_back(path);
  for (Source& source : sources_) source.channel = 0;
}

/// Counts messages that were missed: a writer keeps only some for a reader that is behind.
void Recording::follow(const Source& source, const WireHeader& header) {
  if (source.topic.profile == Profile::kState) return;  // only the newest is promised
  const auto [newest, first] =
      newest_.try_emplace({source.topic.name, header.sender, header.incarnation}, header.message);
  if (first || header.message <= newest->second) return;
  counts_[source.topic.name].missed += header.message - newest->second - 1;
  newest->second = header.message;
}

void Recording::write(Source& source) {
  // Messages without a readable header are kept, for those who read the file.
  const auto header = header_of(taken_);
  if (header) follow(source, *header);
  if (header && !options_.session.empty() && header->session != options_.session) {
    ++other_sessions_;
    return;
  }
  if (options_.split > 0 && writer_->bytes() >= options_.split) {
    writer_->close();
    begin_file();
  }
  if (source.channel == 0)
    source.channel = writer_->add({source.topic.name,
                                   source.topic.type,
                                   "omgidl",
                                   idl_of(source.topic.type),
                                   "cdr",
                                   {{"profile", name_of(source.topic.profile)},
                                    {"type", source.topic.type},
                                    {"protocol", std::to_string(msg::PROTOCOL)}}});
  writer_->write(source.channel, now_nanoseconds(), taken_);
  Count& count = counts_[source.topic.name];
  ++count.messages;
  count.bytes += taken_.size();
}

void Recording::poll() {
  bool more = true;
  while (more) {
    more = false;
    for (Source& source : sources_) {
      int taken = 0;
      while (taken < kAtOnce && source.subscription->take(taken_)) {
        write(source);
        ++taken;
      }
      more = more || taken == kAtOnce;
    }
  }
  if (const std::uint64_t since = writer_->waiting_since(); since != 0 && now_nanoseconds() - since >= kFlushAfter)
    writer_->flush();
}

void Recording::close() {
  poll();
  writer_->close();
}

}  // namespace citylearn
