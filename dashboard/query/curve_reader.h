// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dashboard/store/decimate.h"

namespace citylearn {

/// A metric of a logged run.
struct MetricRow {
  std::string name;
  std::uint64_t points = 0;
  double step = 0, value = 0;      ///< of the newest point; NaN: no number
  double least = 0, greatest = 0;  ///< of all points; NaN: none is a number
};

/// Reads the metrics of logged runs while they are written, over a connection of its own. Used by one thread.
class CurveReader {
 public:
  /// Throws Error, naming the file, as all methods do.
  explicit CurveReader(const std::string& path);
  ~CurveReader();

  /// Returns the metrics of the run in this row of `runs`, by name.
  std::vector<MetricRow> metrics(std::int64_t run);
  /// Returns the figures that the program set itself, as a JSON object; empty: none.
  std::string summary(std::int64_t run);

  enum class Axis { kRecords, kSteps, kSeconds };
  struct Query {
    std::int64_t run = 0;
    std::string metric;
    Axis x = Axis::kSteps;           ///< of kSeconds: since `started`
    double started = 0;              ///< seconds since 1970
    std::optional<double> from, to;  ///< points with from <= x <= to alone
  };
  /// Returns rows of x and value in the order of the log, at most `points` of them. Returns nothing where the run has
  /// no such metric.
  std::optional<Decimator> curve(const Query& query, std::size_t points);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
