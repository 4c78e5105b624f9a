// SPDX-License-Identifier: Apache-2.0
// All training or all episodes of a run, as files. They are made in pieces, each read when the client has taken the one
// before: a slow client holds neither much memory nor the store's log back.
#include <algorithm>
#include <limits>
#include <utility>

#include "core/util/number_set.h"
#include "dashboard/api/api.h"
#include "dashboard/api/tables.h"

namespace citylearn {
namespace {

constexpr std::size_t kRowsPerPiece = 500;

/// Returns an answer to be kept as a file.
Answer file_answer(const std::string& run, const std::string& what, bool csv) {
  Answer answer;
  answer.type = csv ? "text/csv; charset=utf-8" : "application/json";
  std::string name;
  for (const char c : run + "-" + what) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
    name += plain ? c : '-';
  }
  if (csv) answer.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + name + "\"");
  return answer;
}

/// Returns the answer with its first piece. A short one is whole then.
Answer begun(Answer answer, std::function<bool(std::string&)> more) {
  if (more(answer.body)) answer.more = std::move(more);
  return answer;
}

}  // namespace

Answer Api::all_training(const RunRow& row, bool csv) {
  const std::span<const TrainingFigure> columns = training_figures();
  const std::uint64_t last = row.newest ? row.newest->update : 0;  // what comes meanwhile is left out
  Answer answer = file_answer(row.name, csv ? "training.csv" : "training.json", csv);
  std::string& text = answer.body;
  if (csv) {
    for (const TrainingFigure& column : columns) text += (text.empty() ? "" : ",") + std::string(column.name);
    text += '\n';
    return begun(std::move(answer), [this, columns, run = row.id, last, next = std::uint64_t{0}](auto& to) mutable {
      std::size_t rows = 0;
      BorrowedReader reader(*this);
      reader->training(run,
                       [&](std::span<const double> values) {
                         for (std::size_t i = 0; i < columns.size(); ++i) {
                           if (i > 0) to += ',';
                           append_figure(to, columns[i], values[i], true);
                         }
                         to += '\n';
                         ++rows;
                         next = static_cast<std::uint64_t>(values[0]) + 1;
                       },
                       {next, last, kRowsPerPiece});
      return rows == kRowsPerPiece;
    });
  }
  // A column after the other, so the store is read once a column. Updates that are added or removed meanwhile must not
  // make columns of different lengths.
  NumberSet updates;
  {
    BorrowedReader reader(*this);
    updates = reader->updates(row.id, last);
  }
  text = "{\"id\":";
  append_json(text, row.name);
  text += ",\"total\":" + std::to_string(updates.count(1, last)) + ",\"columns\":{";
  return begun(std::move(answer), [this, columns, updates, run = row.id, last, column = std::size_t{0}, first = true,
                                   next = std::uint64_t{0}](std::string& to) mutable {
    const TrainingFigure& figure = columns[column];
    if (next == 0) to += (column == 0 ? "\"" : ",\"") + std::string(figure.name) + "\":[";
    const auto append = [&](double value) {
      if (!std::exchange(first, false)) to += ',';
      append_figure(to, figure, value, false);
    };
    const auto append_missing = [&](std::uint64_t before) {
      for (std::uint64_t gone = before > next ? updates.count(next, before - 1) : 0; gone > 0; --gone)
        append(std::numeric_limits<double>::quiet_NaN());
    };
    std::size_t rows = 0;
    BorrowedReader reader(*this);
    reader->training(
        run,
        [&](std::span<const double> values) {
          const auto update = static_cast<std::uint64_t>(values[0]);
          append_missing(update);
          if (updates.contains(update)) append(values[1]);
          ++rows;
          next = update + 1;
        },
        {next, last, kRowsPerPiece}, &figure);
    if (rows == kRowsPerPiece) return true;
    append_missing(last + 1);
    to += ']';
    first = true;
    next = 0;
    if (++column < columns.size()) return true;
    to += "}}";
    return false;
  });
}

Answer Api::all_episodes(const RunRow& row, bool csv) {
  Answer answer = file_answer(row.name, csv ? "episodes.csv" : "episodes.json", csv);
  if (csv)
    append_csv_episode_header(answer.body);
  else
    answer.body = "{\"episodes\":[";
  // As many as there are now: what is recorded meanwhile comes behind them.
  return begun(std::move(answer), [this, csv, run = row.id, left = row.recorded, total = std::uint64_t{0},
                                   next = std::uint64_t{0}](std::string& text) mutable {
    const std::size_t wanted = std::min<std::uint64_t>(left, kRowsPerPiece);
    std::size_t rows = 0;
    BorrowedReader reader(*this);
    reader->episodes(run,
                     [&](const EpisodeRow& one) {
                       if (csv)
                         text += '\n';
                       else if (total > 0)
                         text += ',';
                       csv ? append_csv_episode(text, one) : append_json_episode(text, one);
                       ++rows;
                       ++total;
                       next = static_cast<std::uint64_t>(one.rowid) + 1;
                     },
                     {.first = next, .limit = wanted});
    left -= rows;
    if (rows == wanted && left > 0) return true;
    text += csv ? "\n" : "],\"total\":" + std::to_string(total) + "}";
    return false;
  });
}

}  // namespace citylearn
