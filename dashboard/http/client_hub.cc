// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/client_hub.h"

#include <algorithm>

#include "core/util/error.h"
#include "dashboard/http/answer.h"

namespace citylearn {
namespace {

/// Returns how a frame begins (docs/reference/dashboard-api.md, "WebSocket"): the header's length in 4 bytes,
/// little-endian, the header, and spaces up to where the payload begins, at a multiple of 8.
std::string frame_head(const std::string& json) {
  const std::size_t length = (json.size() + 4 + 7) / 8 * 8 - 4;
  std::string head;
  head.reserve(length + 4);
  for (int byte = 0; byte < 4; ++byte) head += static_cast<char>(length >> (8 * byte) & 0xFF);
  head += json;
  head.resize(length + 4, ' ');
  return head;
}

}  // namespace

struct ClientHub::Message {
  std::string fields;  // of the header, as JSON without braces: what is the same for every client
  std::uint64_t sequence = 0;
  Merge merge = Merge::kReplace;
  std::size_t rows = 0;  // of kAppend
  std::string columns;   // likewise, as JSON
  std::shared_ptr<const std::vector<std::byte>> payload;

  /// Returns whether rows (of kAppend) have the same columns and length as those of the other.
  bool same_table(const Message& other) const {
    return columns == other.columns && payload->size() / rows == other.payload->size() / other.rows;
  }
};

std::shared_ptr<ClientHub::Client> ClientHub::join(std::function<void()> wake) {
  std::shared_ptr<Client> client(new Client(*this, std::move(wake)));
  const std::lock_guard guard(lock_);
  ++counts_.clients;
  return client;
}

ClientHub::Client::~Client() {
  const std::lock_guard guard(hub_.lock_);
  for (const std::string& topic : topics_) hub_.leave(*this, topic);
  --hub_.counts_.clients;
}

void ClientHub::leave(Client& client, const std::string& topic) {
  const auto found = topics_.find(topic);
  Topic& there = found->second;
  there.watchers.erase(&client);
  if (!there.watchers.empty()) return;
  if (there.newest && options_.linger.count() > 0) {
    there.left = Clock::now();
    ++lingering_;
  } else {
    topics_.erase(found);
  }
}

/// Removes topics without watchers for the linger time.
void ClientHub::forget_topics() const {
  if (lingering_ == 0) return;
  const Clock::time_point now = Clock::now();
  lingering_ -= std::erase_if(topics_, [&](const auto& topic) {
    return topic.second.watchers.empty() && now - topic.second.left >= options_.linger;
  });
}

void ClientHub::Client::watch(const std::set<std::string>& topics) {
  const std::lock_guard guard(hub_.lock_);
  hub_.forget_topics();
  for (const std::string& topic : topics_)
    if (!topics.count(topic)) {
      hub_.leave(*this, topic);
      hub_.forget(*this, topic);
    }
  for (const std::string& topic : topics) {
    if (topics_.count(topic)) continue;
    const auto [found, fresh] = hub_.topics_.try_emplace(topic);
    Topic& there = found->second;
    if (!fresh && there.watchers.empty()) --hub_.lingering_;
    there.watchers.insert(this);
    if (there.newest && there.newest->merge == Merge::kReplace) hub_.enqueue(*this, topic, there.newest);
  }
  topics_ = topics;
}

void ClientHub::forget(Client& client, const std::string& topic) {
  const auto found = client.waiting_.find(topic);
  if (found == client.waiting_.end()) return;
  for (const auto& message : found->second.messages) client.bytes_ -= message->payload->size();
  client.waiting_.erase(found);
  client.order_.erase(std::find(client.order_.begin(), client.order_.end(), topic));
}

void ClientHub::lose(Client& client, std::uint64_t count) {
  client.dropped_ += count;
  counts_.dropped += count;
}

void ClientHub::publish(const std::string& topic, nlohmann::json header, std::vector<std::byte> payload, Merge merge) {
  {
    const std::lock_guard guard(lock_);
    forget_topics();
    if (!topics_.count(topic)) return;
  }
  if (header.is_null()) header = nlohmann::json::object();
  auto message = std::make_shared<Message>();
  message->merge = merge;
  if (merge == Merge::kAppend) {
    message->rows = header.value("rows", std::size_t{0});
    if (message->rows == 0 || payload.size() % message->rows != 0)
      throw Error("its payload is not made of \"rows\" rows", "topic " + topic);
    header.erase("rows");
    message->columns = header.value("columns", nlohmann::json()).dump();
  }
  header["topic"] = topic;
  const std::string text = text_of(header);
  message->fields = text.substr(1, text.size() - 2);
  message->payload = std::make_shared<const std::vector<std::byte>>(std::move(payload));

  const std::lock_guard guard(lock_);
  const auto found = topics_.find(topic);
  if (found == topics_.end()) return;
  Topic& there = found->second;
  if (there.newest && there.newest->merge != merge) throw Error("is merged in two ways", "topic " + topic);
  message->sequence = ++there.sequence;
  there.newest = message;
  ++counts_.published;
  for (Client* client : there.watchers) enqueue(*client, topic, message);
}

void ClientHub::enqueue(Client& client, const std::string& topic, const std::shared_ptr<const Message>& message) {
  const auto [found, fresh] = client.waiting_.try_emplace(topic);
  Client::Waiting& waiting = found->second;
  if (fresh) client.order_.push_back(topic);
  if (message->merge == Merge::kReplace) {
    if (!fresh) lose(client, 1);
  } else {
    if (message->merge == Merge::kEach) {
      while (waiting.messages.size() >= options_.each) drop_first(client, topic);
    } else {
      // Rows of another shape or with other columns cannot be joined.
      while (!waiting.messages.empty() && !waiting.messages.back()->same_table(*message)) drop_first(client, topic);
      waiting.rows += message->rows;
    }
    waiting.messages.push_back(message);
    client.bytes_ += message->payload->size();
    while (waiting.rows > options_.rows) {
      const std::size_t too_many = waiting.rows - options_.rows;
      if (waiting.messages.front()->rows - waiting.skipped <= too_many) {
        drop_first(client, topic);
      } else {
        waiting.rows -= too_many;
        waiting.skipped += too_many;
        lose(client, too_many);
      }
    }
    make_room(client, topic);
  }
  if (client.asleep_) {
    client.asleep_ = false;
    client.wake_();
  }
}

void ClientHub::drop_first(Client& client, const std::string& topic) {
  Client::Waiting& waiting = client.waiting_.at(topic);
  const Message& first = *waiting.messages.front();
  const std::size_t rows = first.rows - waiting.skipped;  // 0 of kEach
  lose(client, first.merge == Merge::kAppend ? rows : 1);
  waiting.rows -= rows;
  waiting.skipped = 0;
  client.bytes_ -= first.payload->size();
  waiting.messages.pop_front();
}

/// Drops messages beyond the bound, of the topic that waits longest first, but never the newest one.
void ClientHub::make_room(Client& client, const std::string& newest) {
  while (client.bytes_ > options_.bytes) {
    const auto oldest = std::find_if(client.order_.begin(), client.order_.end(), [&](const std::string& topic) {
      return client.waiting_.at(topic).messages.size() > (topic == newest ? 1 : 0);
    });
    if (oldest == client.order_.end()) return;
    const std::string topic = *oldest;
    drop_first(client, topic);
    if (client.waiting_.at(topic).messages.empty()) forget(client, topic);
  }
}

std::optional<ClientHub::Frame> ClientHub::Client::next() {
  std::deque<std::shared_ptr<const Message>> messages;
  std::size_t rows = 0, skipped = 0;
  std::uint64_t dropped = 0;
  {
    const std::lock_guard guard(hub_.lock_);
    if (order_.empty()) {
      asleep_ = true;
      return std::nullopt;
    }
    const std::string topic = order_.front();
    Waiting& waiting = waiting_.at(topic);
    dropped = dropped_;
    ++hub_.counts_.taken;
    if (waiting.messages.empty()) {
      messages.push_back(hub_.topics_.at(topic).newest);
      hub_.forget(*this, topic);
    } else if (waiting.messages.front()->merge == Merge::kEach && waiting.messages.size() > 1) {
      // The others wait behind the other topics.
      messages.push_back(waiting.messages.front());
      waiting.messages.pop_front();
      bytes_ -= messages.front()->payload->size();
      order_.pop_front();
      order_.push_back(topic);
    } else {
      messages = waiting.messages;
      rows = waiting.rows;
      skipped = waiting.skipped;
      hub_.forget(*this, topic);
    }
  }
  // No lock is needed from here on, as messages never change.
  const Message& last = *messages.back();
  std::string json =
      "{" + last.fields + ",\"sequence\":" + std::to_string(last.sequence) + ",\"dropped\":" + std::to_string(dropped);
  if (last.merge == Merge::kAppend) json += ",\"rows\":" + std::to_string(rows);
  Frame frame{frame_head(json + "}"), last.payload};
  if (messages.size() == 1 && skipped == 0) return frame;
  const std::size_t row = last.payload->size() / last.rows;
  std::vector<std::byte> joined;
  joined.reserve(rows * row);
  for (const auto& message : messages) {
    joined.insert(joined.end(), message->payload->begin() + static_cast<std::ptrdiff_t>(skipped * row),
                  message->payload->end());
    skipped = 0;
  }
  frame.payload = std::make_shared<const std::vector<std::byte>>(std::move(joined));
  return frame;
}

std::vector<std::string> ClientHub::watched() const {
  const std::lock_guard guard(lock_);
  forget_topics();
  std::vector<std::string> topics;
  topics.reserve(topics_.size());
  for (const auto& [topic, what] : topics_) topics.push_back(topic);
  return topics;
}

ClientHub::Counts ClientHub::counts() const {
  const std::lock_guard guard(lock_);
  return counts_;
}

}  // namespace citylearn
