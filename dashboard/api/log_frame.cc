// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/log_frame.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "dashboard/api/text_member.h"
#include "dashboard/http/answer.h"
#include "dashboard/http/frame.h"
#include "dashboard/logged/logged_runs.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

static_assert(std::endian::native == std::endian::little, "numbers are sent as they lie in memory");
static_assert(kPointsOfFrame >= 2 * kMostMetrics);

constexpr std::size_t kPointBytes = 3 * sizeof(double) + 2 * sizeof(std::uint32_t);

/// Appends a column, which `number` gives, to a payload.
template <class Number>
void append_column(std::string& bytes, std::size_t count, Number number) {
  using Value = std::invoke_result_t<Number, std::size_t>;
  const std::size_t at = bytes.size();
  bytes.resize(at + count * sizeof(Value));
  for (std::size_t i = 0; i < count; ++i) {
    const Value value = number(i);
    std::memcpy(bytes.data() + at + i * sizeof value, &value, sizeof value);
  }
}

template <class Value>
Value value_of(std::string_view payload, std::size_t at, std::size_t i) {
  Value value;
  std::memcpy(&value, payload.data() + at + i * sizeof value, sizeof value);
  return value;
}

std::uint64_t count_of_member(const Json& header, const char* name, std::uint64_t least, std::uint64_t most) {
  const Json count = header.value(name, Json());
  if (!count.is_number_unsigned() || count < least || count > most)
    throw Error("must be a number from " + std::to_string(least) + " to " + std::to_string(most),
                "'" + std::string(name) + "' of the header");
  return count.get<std::uint64_t>();
}

}  // namespace

std::string log_frame(const LogBatch& batch, std::size_t from, std::size_t to, bool last) {
  const LoggedPoint* points = batch.points().data() + from;
  const std::size_t count = to - from;
  // A batch that begins with a record of another kind, or ends with one, has no points alone.
  const std::uint64_t first = points[0].record;
  Json header = {
      {"source", batch.source}, {"log", batch.log}, {"first", first}, {"metrics", batch.metrics()}, {"points", count}};
  if (last && batch.ended) header["ended"] = *batch.ended;
  std::string frame = frame_head(text_of(header));
  frame.reserve(frame.size() + count * kPointBytes);
  append_column(frame, count, [&](std::size_t i) { return points[i].step; });
  append_column(frame, count, [&](std::size_t i) { return points[i].time; });
  append_column(frame, count, [&](std::size_t i) { return points[i].value; });
  append_column(frame, count, [&](std::size_t i) { return static_cast<std::uint32_t>(points[i].record - first); });
  append_column(frame, count, [&](std::size_t i) { return points[i].metric; });
  return frame;
}

LogBatch parse_log_frame(std::string_view frame) {
  const auto parts = split_frame(frame);
  if (!parts) throw Error("is cut short", "the frame", "4 bytes with the header's length, the header, the numbers");
  const auto& [text, payload] = *parts;
  const Json header = parse_json(text, "the header");
  if (!header.is_object()) throw Error("must be an object", "the header");
  LogBatch batch(count_of_member(header, "first", 1, kMostRecords));
  batch.source = text_member(header, "source", kLongestSource).value_or("");
  batch.log = text_member(header, "log", kLongestSource).value_or("");
  if (header.contains("ended")) {
    if (!header["ended"].is_boolean()) throw Error("must be true or false", "'ended' of the header");
    batch.ended = header["ended"].get<bool>();
  }
  const Json metrics = header.value("metrics", Json());
  if (!metrics.is_array() || metrics.size() > kMostMetrics)
    throw Error("must be a list of at most " + std::to_string(kMostMetrics) + " names", "'metrics' of the header");
  for (const Json& name : metrics) {
    const auto fault = name.is_string() ? fault_of_metric(name.get<std::string>()) : "a name is a text";
    if (fault) throw Error(*fault, "'metrics' of the header");
    const std::size_t names = batch.metrics().size();
    if (batch.index_of(name.get<std::string>()) != names)
      throw Error("names '" + name.get<std::string>() + "' twice", "'metrics' of the header");
  }
  const std::size_t count = count_of_member(header, "points", 1, payload.size() / kPointBytes);
  if (payload.size() != count * kPointBytes)
    throw Error("has " + std::to_string(payload.size()) + " bytes, not " + std::to_string(count * kPointBytes),
                "the payload", "each point has " + std::to_string(kPointBytes));
  batch.reserve(count);
  const std::size_t column = count * sizeof(double), records = 3 * column, names = records + column / 2;
  for (std::size_t i = 0; i < count; ++i) {
    const auto record = value_of<std::uint32_t>(payload, records, i) + batch.first();
    if (record == batch.end_record() + 1 && i > 0) batch.points_done();
    const auto metric = value_of<std::uint32_t>(payload, names, i);
    const auto step = value_of<double>(payload, 0, i), time = value_of<double>(payload, column, i);
    if (record != batch.end_record() || metric >= batch.metrics().size() || !std::isfinite(step) ||
        !std::isfinite(time))
      throw Error("has a record, metric, step or time that cannot be", "point " + std::to_string(i),
                  "records count from 0 on without gaps, metrics are indices, step and time are finite");
    batch.add(metric, step, time, value_of<double>(payload, 2 * column, i));
  }
  batch.points_done();
  return batch;
}

}  // namespace citylearn
