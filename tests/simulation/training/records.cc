// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/training/records.h"

#include <filesystem>
#include <fstream>

#include "core/files/csv.h"
#include "core/recording/mcap.h"
#include "core/wire/messages.h"
#include "dashboard/store/database.h"
#include "tests/simulation/training/services.h"

namespace citylearn::simulation {

void read_csv(const std::string& path, Records& records) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    const std::vector<std::string> fields = csv_fields(line);
    if (fields.size() > 3) ++records.recorded[{fields[0], std::stoull(fields[1])}][std::stoull(fields[2])];
  }
}

void read_store(const std::string& path, Records& records) {
  if (!std::filesystem::exists(path)) return;
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source");
  while (rows.executeStep()) {
    const std::uint64_t incarnation = std::stoull(value_at<std::string>(rows, 1));
    ++records.recorded[{value_at<std::string>(rows, 0), incarnation}][std::stoull(value_at<std::string>(rows, 2))];
  }
  SQLite::Statement sources(database, "SELECT environment, incarnation, contiguous, missed FROM sources");
  while (sources.executeStep()) {
    const Source source(value_at<std::string>(sources, 0), std::stoull(value_at<std::string>(sources, 1)));
    records.settled[source] = value_at<std::uint64_t>(sources, 2);
    records.missed[source] = value_at<std::uint64_t>(sources, 3);
  }
}

std::string read_recordings(Records& records) {
  std::string fault;
  for (const std::string& path : recordings()) try {
      Records found;
      McapReader reader(path);
      while (const auto message = reader.next()) {
        if (message->channel->topic != topic_of<msg::EpisodeStat>().name) continue;
        msg::EpisodeStat stat;
        try {
          decode(message->data, stat);
        } catch (const Error&) {
          continue;  // it came like that
        }
        ++found.recorded[{stat.header().sender().c_str(), stat.header().incarnation()}][stat.log().number()];
      }
      for (const auto& [source, episodes] : found.recorded)
        for (const auto& [episode, count] : episodes) records.recorded[source][episode] += count;
    } catch (const Error& error) {
      fault = error.what();
    }
  return fault;
}

}  // namespace citylearn::simulation
