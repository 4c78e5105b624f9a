// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

namespace citylearn {

/// The page's files, read once into memory. Only files in this table are served, whatever a path says.
class Page {
 public:
  struct File {
    std::string type;        ///< MIME
    std::string body;        ///< bytes
    std::string compressed;  ///< the same with gzip; empty if the build made none
    std::string tag;         ///< ETag, in quotes
    bool hashed = false;     ///< its name changes with its content, so it may be cached forever
  };

  Page() = default;
  /// Reads every regular file below `folder`; "x.js.gz" is the compressed form of "x.js". Does not follow links. A
  /// missing folder gives an empty page. Throws Error for an unreadable file, and beyond 64 MiB.
  explicit Page(const std::string& folder);

  /// Returns the file of a path as sent ("/" is "/index.html"), or null.
  const File* find(const std::string& path) const;
  bool empty() const { return files_.empty(); }

 private:
  std::map<std::string, File> files_;  // by "/" + path below the folder
};

}  // namespace citylearn
