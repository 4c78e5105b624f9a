// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace citylearn {

/// One SELECT over the store, on a connection that can only read: an authorizer refuses every statement that writes,
/// attaches files, sets pragmas or loads code. Bounded in time, rows and bytes.
class SqlQuery {
 public:
  struct Options {
    std::size_t rows = 1000;
    std::size_t bytes = 16 << 20;  ///< of all values together
    std::chrono::milliseconds time{5'000};
  };
  struct Blob {
    std::size_t bytes;
  };
  /// NULL, an integer, a real, a text, or how large a blob is.
  using Value = std::variant<std::monostate, std::int64_t, double, std::string, Blob>;
  struct Result {
    std::vector<std::string> columns;
    std::vector<std::vector<Value>> rows;
    bool truncated = false;  ///< there are more rows than `rows` or `bytes` allow
  };

  /// Runs `sql` on the store `path`. Throws Error that says what is wrong with the SQL, or that it took too long.
  static Result run(const std::string& path, const std::string& sql, const Options& options);
};

}  // namespace citylearn
