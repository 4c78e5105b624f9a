// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/interprocess/file_mapping.hpp>
#include <boost/interprocess/mapped_region.hpp>
#include <filesystem>
#include <string>
#include <string_view>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn {

/// A file as bytes, of which only those in use are in memory.
class MappedFile {
 public:
  /// Throws Error, naming the file, when it cannot be read.
  explicit MappedFile(const std::string& path) {
    refuse_special_file(path);
    std::error_code wrong;
    const auto size = std::filesystem::file_size(path, wrong);
    if (!wrong && size == 0) return;  // an empty file cannot be mapped
    try {
      using namespace boost::interprocess;
      region_ = mapped_region(file_mapping(path.c_str(), read_only), read_only);
      region_.advise(mapped_region::advice_sequential);
    } catch (const boost::interprocess::interprocess_exception& error) {
      throw Error(std::string("cannot be read: ") + error.what(), path);
    }
  }
  std::string_view bytes() const { return {static_cast<const char*>(region_.get_address()), region_.get_size()}; }

 private:
  boost::interprocess::mapped_region region_;
};

}  // namespace citylearn
