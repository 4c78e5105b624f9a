// SPDX-License-Identifier: Apache-2.0
#include "dashboard/store/route_store.h"

#include <algorithm>
#include <bit>
#include <set>

#include "core/util/sha256.h"
#include "core/wire/streets.h"
#include "dashboard/store/database.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are stored as they are");

constexpr int kMaxParts = 4;  // of a traversal at a time: those of its newest runs

/// Selects which runs use which traversals, without rows whose episodes a run has claimed since.
const std::string kUses =
    " FROM sources s JOIN run_sources u ON u.source = s.id"
    " JOIN runs r ON r.id = u.run AND (r.run_id IS NOT NULL OR r.recorded > 0) WHERE s.hash ";

/// The part that the runs of a traversal are on, as their manifests tell; without one it is all of the traversal.
const std::string kParts =
    "SELECT MAX(run), first, frames FROM (SELECT r.id AS run,"
    " CASE WHEN json_valid(r.manifest) THEN json_extract(r.manifest, '$.first_frame') END AS first,"
    " CASE WHEN json_valid(r.manifest) THEN json_extract(r.manifest, '$.frames') END AS frames" +
    kUses + "= ?1) GROUP BY first, frames ORDER BY 1 DESC LIMIT ?2";

struct Sums {
  std::uint64_t all = 0, pictures = 0;
};

template <class... Values>
Sums sum(SQLite::Database& database, const std::string& where, const Values&... values) {
  SQLite::Statement row(database,
                        "SELECT SUM(length(p.bytes)), COUNT(*) FROM places f JOIN pictures p ON p.id = f.picture "
                        "WHERE f.frame BETWEEN ?2 AND ?3 AND f.hash " +
                            where);
  Sums bytes;
  if (bind_values(row, values...).executeStep()) read_row(row, bytes.all, bytes.pictures);
  return bytes;
}

/// Returns how many bytes of pictures may still be added to this part of a traversal; 0 when a picture as large as the
/// mean one does not fit any more.
std::size_t room(SQLite::Database& database, const RouteStore::Options& options, std::uint64_t hash,
                 const RouteStore::Part& part) {
  const Sums traversal = sum(database, "= ?1", hash, part.first, part.last);
  const Sums run = sum(database,
                       "IN (SELECT s.hash FROM run_sources u JOIN sources s ON s.id = u.source "
                       "WHERE u.run = ?1 AND s.hash IS NOT NULL)",
                       part.run, part.first, part.last);
  if (traversal.all >= options.traversal_bytes || run.all >= options.run_bytes) return 0;
  const std::size_t left = std::min(options.traversal_bytes - traversal.all, options.run_bytes - run.all);
  return traversal.pictures > 0 && left < traversal.all / traversal.pictures ? 0 : left;
}

bool is_shown(SQLite::Database& database, std::uint64_t hash) {
  SQLite::Statement row(database, "SELECT 1" + kUses + "= ?1 LIMIT 1");
  return bind_values(row, hash).executeStep();
}

template <class Number>
std::span<const std::uint8_t> blob_of(const std::vector<Number>& numbers) {
  return {reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size() * sizeof(Number)};
}

std::vector<RouteStore::Part> parts_of(SQLite::Database& database, const TraversalRow& traversal) {
  std::vector<RouteStore::Part> parts;
  SQLite::Statement row(database, kParts);
  bind_values(row, traversal.hash, kMaxParts);
  while (row.executeStep()) {
    RouteStore::Part& part = parts.emplace_back();
    std::int64_t first = 0;
    std::optional<std::int64_t> frames;
    read_row(row, part.run, first, frames);
    const auto last = static_cast<std::int64_t>(traversal.frames) - 1;
    first = std::clamp<std::int64_t>(first, 0, last);
    part.first = static_cast<std::uint32_t>(first);
    part.last = static_cast<std::uint32_t>(
        std::clamp<std::int64_t>(frames && *frames > 0 && *frames <= last ? first + *frames - 1 : last, first, last));
  }
  return parts;
}

}  // namespace

std::vector<std::uint32_t> spread_frames(std::uint32_t first, std::uint32_t last, std::size_t most) {
  const std::uint64_t frames = std::uint64_t{last} - first + 1;
  const std::uint64_t count = std::min<std::uint64_t>(frames, most);
  std::vector<std::uint32_t> spread;
  // Numbers with their bits reversed: 0, 1/2, 1/4, 3/4, 1/8 ... of the way.
  const auto bits = static_cast<int>(std::bit_width(count - 1));
  for (std::uint64_t i = 0; i < std::uint64_t{1} << bits; ++i) {
    std::uint64_t place = 0;
    for (int bit = 0; bit < bits; ++bit) place |= (i >> bit & 1) << (bits - 1 - bit);
    if (place >= count) continue;
    spread.push_back(first + static_cast<std::uint32_t>(count == 1 ? 0 : place * (frames - 1) / (count - 1)));
  }
  return spread;
}

RouteStore::Gaps RouteStore::gaps(const TraversalRow& traversal) {
  Gaps gaps;
  if (traversal.frames == 0) return gaps;
  store_.with_database([&](SQLite::Database& database) {
    const std::vector<Part> parts = parts_of(database, traversal);
    if (parts.empty()) return;
    SQLite::Statement map(database, "SELECT 1 FROM maps WHERE hash = ?");
    gaps.map = traversal.frames <= options_.map_frames && !bind_values(map, traversal.hash).executeStep();
    if (!traversal.images) return;
    std::set<std::uint32_t> there;
    for (const Part& part : parts) {
      if (room(database, options_, traversal.hash, part) == 0) continue;
      SQLite::Statement place(database, "SELECT frame FROM places WHERE hash = ? AND frame BETWEEN ? AND ?");
      bind_values(place, traversal.hash, part.first, part.last);
      while (place.executeStep()) there.insert(value_at<std::uint32_t>(place, 0));
      for (const std::uint32_t frame : spread_frames(part.first, part.last, options_.places))
        if (there.insert(frame).second) gaps.places.push_back({part, frame});
    }
  });
  return gaps;
}

bool RouteStore::keep(std::uint64_t hash, const RouteMap& map) {
  bool kept = false;
  store_.with_database([&](SQLite::Database& database) {
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    if (!is_shown(database, hash)) return;
    const Bytes streets = map.streets ? encode_streets(*map.streets) : Bytes();
    run(database,
        "INSERT OR IGNORE INTO maps (hash, frames, position, latitude, longitude, rule, streets) "
        "VALUES (?, ?, ?, ?, ?, ?, ?)",
        hash, map.frames, blob_of(map.position), blob_of(map.latitude), blob_of(map.longitude),
        static_cast<std::uint32_t>(map.rule), blob_of(streets));
    all.commit();
    kept = true;
  });
  return kept;
}

bool RouteStore::keep(std::uint64_t hash, const Gaps::Place& place, const PictureFile& picture) {
  bool kept = false;
  const std::string content = sha256(picture.bytes);
  store_.with_database([&](SQLite::Database& database) {
    SQLite::Transaction all(database, SQLite::TransactionBehavior::IMMEDIATE);
    if (!is_shown(database, hash) || room(database, options_, hash, place.part) < picture.bytes.size()) return;
    const std::span bytes(reinterpret_cast<const std::uint8_t*>(picture.bytes.data()), picture.bytes.size());
    run(database, "INSERT OR IGNORE INTO pictures (content, type, bytes) VALUES (?, ?, ?)", content, picture.type,
        bytes);
    run(database,
        "INSERT OR IGNORE INTO places (hash, frame, picture) SELECT ?1, ?2, id FROM pictures WHERE content = ?3", hash,
        place.frame, content);
    all.commit();
    kept = true;
  });
  return kept;
}

void remove_unused_routes(SQLite::Database& database) {
  const std::string unused = "hash NOT IN (SELECT s.hash" + kUses + "IS NOT NULL)";
  run(database, ("DELETE FROM maps WHERE " + unused).c_str());
  run(database, ("DELETE FROM places WHERE " + unused).c_str());
  run(database, "DELETE FROM pictures WHERE id NOT IN (SELECT picture FROM places)");
}

}  // namespace citylearn
