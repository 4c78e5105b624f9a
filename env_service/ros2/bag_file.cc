// SPDX-License-Identifier: Apache-2.0
#include <SQLiteCpp/SQLiteCpp.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>

#include "core/files/files.h"
#include "core/recording/compression.h"
#include "core/recording/mcap.h"
#include "core/util/error.h"
#include "env_service/files/files.h"
#include "env_service/ros2/bag.h"

namespace citylearn {
namespace {

class McapBagFile : public BagFile {
 public:
  explicit McapBagFile(const std::string& path) : reader_(path) {}

  void read_all(const BagVisitor& visitor) override {
    std::map<const McapChannel*, std::size_t> topics;
    while (const auto message = reader_.next()) {
      const McapChannel* const channel = message->channel;
      const auto [topic, added] = topics.try_emplace(channel);
      if (added)
        topic->second = visitor.topic(
            {channel->topic, channel->type, channel->encoding, channel->schema_encoding, channel->schema});
      if (visitor.count(topic->second))
        visitor.use(
            {topic->second, message->log_time, message->data, {0, message->place.record, message->place.offset}});
    }
    if (!reader_.missing().empty()) throw Error(reader_.missing(), reader_.path());
  }
  std::span<const std::byte> read(const BagPlace& place) override {
    return reader_.read({place.record, place.offset}).data;
  }

 private:
  McapReader reader_;
};

/// Tables `topics` and `messages`, which all versions have with at least these columns.
class SqliteBagFile : public BagFile {
 public:
  SqliteBagFile(const std::string& path, const std::string& name) : name_(name) {
    std::string escaped;
    for (const char c : path) escaped += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
    // Nothing is written beside it, unless the recorder left rows there that have to be read too.
    const bool whole = !is_file(path + "-wal") && !is_file(path + "-journal");
    guarded([&] {
      database_ = std::make_unique<SQLite::Database>("file:" + escaped + (whole ? "?immutable=1" : ""),
                                                     SQLite::OPEN_READONLY | SQLite::OPEN_URI);
      database_->exec("PRAGMA writable_schema = ON");  // else all is refused where a file was cut short
      message_ = std::make_unique<SQLite::Statement>(*database_, "SELECT data FROM messages WHERE id = ?");
    });
  }

  void read_all(const BagVisitor& visitor) override {
    guarded([&] {
      std::map<std::int64_t, std::size_t> topics;
      std::map<std::string, std::string> definitions;  // by type; of version 4 of the tables
      if (database_->tableExists("message_definitions")) {
        SQLite::Statement known(*database_,
                                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                                "WHERE encoding = 'ros2msg'");
        while (known.executeStep()) definitions[known.getColumn(0).getString()] = known.getColumn(1).getString();
      }
      SQLite::Statement names(*database_, "SELECT id, name, type, serialization_format FROM topics");
      while (names.executeStep())
        topics[names.getColumn(0).getInt64()] =
            visitor.topic({names.getColumn(1).getString(), names.getColumn(2).getString(),
                           names.getColumn(3).getString(), "ros2msg", definitions[names.getColumn(2).getString()]});
      SQLite::Statement rows(*database_, "SELECT id, topic_id, timestamp, length(data) FROM messages");
      while (rows.executeStep()) {
        const auto topic = topics.find(rows.getColumn(1).getInt64());
        if (topic == topics.end() || !visitor.count(topic->second)) continue;
        const auto id = static_cast<std::uint64_t>(rows.getColumn(0).getInt64()),
                   time = static_cast<std::uint64_t>(rows.getColumn(2).getInt64());
        const bool fits = rows.getColumn(3).getInt64() <= static_cast<std::int64_t>(Bag::kMaxMessageBytes);
        visitor.use({topic->second, time, fits ? data(id) : std::span<const std::byte>(), {0, id, 0}});
      }
    });
  }
  std::span<const std::byte> read(const BagPlace& place) override {
    std::span<const std::byte> found;
    guarded([&] { found = data(place.record); });
    return found;
  }

 private:
  template <class Do>
  void guarded(const Do& act) {
    try {
      act();
    } catch (const SQLite::Exception& error) {
      throw Error(std::string("cannot be read as a bag: ") + error.what(), name_);
    }
  }
  std::span<const std::byte> data(std::uint64_t id) {
    message_->reset();
    message_->bind(1, static_cast<std::int64_t>(id));
    if (!message_->executeStep()) throw Error("row " + std::to_string(id) + " is gone", name_);
    const SQLite::Column column = message_->getColumn(0);
    return {static_cast<const std::byte*>(column.getBlob()), static_cast<std::size_t>(column.getBytes())};
  }

  const std::string name_;
  std::unique_ptr<SQLite::Database> database_;
  std::unique_ptr<SQLite::Statement> message_;
};

/// Decompresses a file into a temporary one, and returns its path.
std::string temporary_copy(const std::string& path) {
  std::error_code error;
  std::string copy = (std::filesystem::temp_directory_path(error) / "citylearn-bag-XXXXXX").string();
  if (error) throw Error("is not a folder", "TMPDIR", "it names the one for temporary files");
  const int file = ::mkstemp(copy.data());
  if (file < 0) throw Error(std::string("cannot be made: ") + std::strerror(errno), copy, "TMPDIR names its folder");
  ::close(file);
  std::ifstream in(path, std::ios::binary);
  std::ofstream out(copy, std::ios::binary);
  std::string block(std::size_t{1} << 17, '\0');
  const auto read = [&] {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    return std::string_view(block).substr(0, static_cast<std::size_t>(in.gcount()));
  };
  const auto write = [&](std::string_view bytes) {
    return static_cast<bool>(out.write(bytes.data(), static_cast<std::streamsize>(bytes.size())));
  };
  const std::string fault = decompress("zstd", read, write);
  out.close();
  if (out && fault.empty()) return copy;
  ::unlink(copy.c_str());
  throw out ? Error(fault, path) : Error("does not fit, decompressed, into the temporary folder", path, "set TMPDIR");
}

std::string first_bytes(const std::string& path) {
  refuse_special_file(path);
  std::array<char, 16> bytes{};
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error(std::string("cannot be read: ") + std::strerror(errno), path);
  file.read(bytes.data(), bytes.size());
  return {bytes.data(), static_cast<std::size_t>(file.gcount())};
}

std::unique_ptr<BagFile> opened(const std::string& path, const std::string& name) {
  const std::string magic = first_bytes(path);
  if (magic.starts_with("\x89MCAP")) return std::make_unique<McapBagFile>(path);
  if (magic.starts_with("SQLite format 3")) return std::make_unique<SqliteBagFile>(path, name);
  throw Error(magic.empty() ? "is empty" : "is neither MCAP nor SQLite", name);
}

}  // namespace

std::unique_ptr<BagFile> open_bag_file(const std::string& path) {
  if (!first_bytes(path).starts_with("\x28\xb5\x2f\xfd")) return opened(path, path);
  const std::string copy = temporary_copy(path);
  const auto unlink = [](const std::string* name) { ::unlink(name->c_str()); };  // what is open can be read on
  const std::unique_ptr<const std::string, decltype(unlink)> guard(&copy);
  return opened(copy, path);
}

}  // namespace citylearn
