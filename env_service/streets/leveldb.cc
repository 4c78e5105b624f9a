// SPDX-License-Identifier: Apache-2.0
#include "env_service/streets/leveldb.h"

#include <leveldb/db.h>
#include <leveldb/env.h>

#include <filesystem>
#include <regex>

#include "core/util/error.h"

namespace citylearn {
namespace {

/// A file that takes everything and keeps nothing.
class DiscardedFile : public leveldb::WritableFile {
 public:
  leveldb::Status Append(const leveldb::Slice&) override { return {}; }
  leveldb::Status Close() override { return {}; }
  leveldb::Status Flush() override { return {}; }
  leveldb::Status Sync() override { return {}; }
};

/// The file system without a way to change it. On opening, LevelDB renews its manifest and begins a log, which it does
/// not read again: these are discarded. It does read the tables that it writes, so those cannot be written; a
/// compaction then fails, in the background, and reading goes on.
class ReadOnlyEnv : public leveldb::EnvWrapper {
 public:
  ReadOnlyEnv() : EnvWrapper(leveldb::Env::Default()) {}
  leveldb::Status NewWritableFile(const std::string& file, leveldb::WritableFile** result) override {
    *result = nullptr;
    if (file.ends_with(".ldb") || file.ends_with(".sst"))
      return leveldb::Status::NotSupported("its last writer left it unfinished: open it with LevelDB once");
    *result = new DiscardedFile;
    return {};
  }
  leveldb::Status NewAppendableFile(const std::string&, leveldb::WritableFile** result) override {
    *result = new DiscardedFile;
    return {};
  }
  leveldb::Status NewLogger(const std::string&, leveldb::Logger** result) override {
    *result = nullptr;
    return leveldb::Status::NotSupported("read-only");  // it goes without
  }
  leveldb::Status RemoveFile(const std::string&) override { return {}; }
  leveldb::Status CreateDir(const std::string&) override { return {}; }
  leveldb::Status RemoveDir(const std::string&) override { return {}; }
  leveldb::Status RenameFile(const std::string&, const std::string&) override { return {}; }
  leveldb::Status LockFile(const std::string&, leveldb::FileLock** lock) override {
    *lock = new leveldb::FileLock;
    return {};
  }
  leveldb::Status UnlockFile(leveldb::FileLock* lock) override {
    delete lock;
    return {};
  }
};

}  // namespace

struct LevelDb::Impl {
  const std::unique_ptr<leveldb::Env> env = std::make_unique<ReadOnlyEnv>();  // outlives db
  std::unique_ptr<leveldb::DB> db;
};

bool LevelDb::owns(const std::string& name) {
  static const std::regex names(R"(CURRENT|LOCK|LOG(\.old)?|MANIFEST-\d+|\d+\.(ldb|sst|log))");
  return std::regex_match(name, names);
}

bool LevelDb::is_in(const std::string& folder) {
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    if (at->path().filename() == "CURRENT" || at->path().extension() == ".ldb") return true;
  return false;
}

LevelDb::LevelDb(const std::string& folder) : folder_(folder), impl_(std::make_unique<Impl>()) {
  leveldb::Options options;
  options.env = impl_->env.get();
  options.paranoid_checks = true;
  options.reuse_logs = true;            // keeps what is in the log in memory ...
  options.write_buffer_size = 1 << 30;  // ... whatever its size, instead of writing a table of it
  options.max_open_files = 100;         // services have other files open
  leveldb::DB* db = nullptr;
  const leveldb::Status status = leveldb::DB::Open(options, folder, &db);
  impl_->db.reset(db);
  if (!status.ok()) throw Error("cannot be read as a LevelDB: " + status.ToString(), folder, "copy it again");
}

LevelDb::~LevelDb() = default;

bool LevelDb::read(const std::string& key, std::string& value) const {
  leveldb::ReadOptions options;
  options.verify_checksums = true;
  options.fill_cache = false;  // values are large and read once
  const leveldb::Status status = impl_->db->Get(options, key, &value);
  if (status.ok() || status.IsNotFound()) return status.ok();
  throw Error("key " + key + " cannot be read: " + status.ToString(), folder_, "copy the folder again");
}

}  // namespace citylearn
