// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace citylearn {

/// A LevelDB that is read and never written, though LevelDB itself writes into a folder that it opens: the folder's
/// bytes stay as they are, it may be read-only, and any number of readers may have it open. Memory is that of the
/// tables' indices and, where the last writer left them, of its log. Threads may share it.
class LevelDb {
 public:
  /// Returns whether a file of this name, without folders, belongs to a LevelDB: "CURRENT", "000005.ldb".
  static bool owns(const std::string& name);
  /// Returns whether there is a LevelDB in a folder, sound or not: the file that names its manifest, or a table.
  static bool is_in(const std::string& folder);

  /// Throws Error naming the folder when it is damaged or not a LevelDB.
  explicit LevelDb(const std::string& folder);
  ~LevelDb();
  /// Reads the value of `key`. Returns false when there is none. Throws Error naming folder and key when the database
  /// is damaged there.
  bool read(const std::string& key, std::string& value) const;
  const std::string& folder() const { return folder_; }

 private:
  struct Impl;
  const std::string folder_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
