// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

namespace citylearn {

/// The page's files, read once into memory: what is not in this table cannot be asked for, whatever a path says.
class Page {
 public:
  struct File {
    std::string type;        ///< MIME
    std::string body;        ///< bytes
    std::string compressed;  ///< the same with gzip; empty where the build made none
    std::string tag;         ///< ETag, in quotes
    bool hashed = false;     ///< its name changes with its content: cacheable for ever
  };

  Page() = default;
  /// Every regular file below `folder`; "x.js.gz" beside "x.js" is that one's compressed form. Links are not followed.
  /// A folder that is not there gives an empty page. Throws Error for a file that cannot be read, and beyond 64 MiB.
  explicit Page(const std::string& folder);

  /// The file of a path as it was sent ("/" is "/index.html"); null where there is none.
  const File* find(const std::string& path) const;
  bool empty() const { return files_.empty(); }

 private:
  std::map<std::string, File> files_;  // by "/" + path below the folder
};

}  // namespace citylearn
