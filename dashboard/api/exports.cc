// SPDX-License-Identifier: Apache-2.0
// All training or all episodes of a run, as files. They are made in pieces, each read when the client has taken the one
// before: a slow client holds neither much memory nor the store's log back.
#include <algorithm>
#include <utility>

#include "dashboard/api/api.h"
#include "dashboard/api/tables.h"

namespace citylearn {
namespace {

constexpr std::size_t kRowsPerPiece = 500;

/// Returns an answer to be kept as a file.
Answer csv_answer(const std::string& run, const std::string& what) {
  Answer answer;
  answer.type = "text/csv; charset=utf-8";
  std::string name;
  for (const char c : run + "-" + what) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
    name += plain ? c : '-';
  }
  answer.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + name + "\"");
  return answer;
}

/// Returns the answer with its first piece. A short one is whole then.
Answer begun(Answer answer, std::function<bool(std::string&)> more) {
  if (more(answer.body)) answer.more = std::move(more);
  return answer;
}

}  // namespace

Answer Api::all_training(const RunRow& row) {
  const std::span<const TrainingFigure> columns = training_figures();
  const std::uint64_t last = row.newest ? row.newest->update : 0;  // what comes meanwhile is left out
  Answer answer = csv_answer(row.name, "training.csv");
  for (const TrainingFigure& column : columns)
    answer.body += (answer.body.empty() ? "" : ",") + std::string(column.name);
  answer.body += '\n';
  return begun(std::move(answer),
               [this, columns, run = row.id, last, next = std::uint64_t{0}](std::string& to) mutable {
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

Answer Api::all_episodes(const RunRow& row) {
  Answer answer = csv_answer(row.name, "episodes.csv");
  append_csv_episode_header(answer.body);
  // As many as there are now: what is recorded meanwhile comes behind them.
  return begun(std::move(answer),
               [this, run = row.id, left = row.recorded, next = std::uint64_t{0}](std::string& text) mutable {
                 const std::size_t wanted = std::min<std::uint64_t>(left, kRowsPerPiece);
                 std::size_t rows = 0;
                 BorrowedReader reader(*this);
                 reader->episodes(run,
                                  [&](const EpisodeRow& one) {
                                    text += '\n';
                                    append_csv_episode(text, one);
                                    ++rows;
                                    next = static_cast<std::uint64_t>(one.rowid) + 1;
                                  },
                                  {.first = next, .limit = wanted});
                 left -= rows;
                 if (rows == wanted && left > 0) return true;
                 text += '\n';
                 return false;
               });
}

}  // namespace citylearn
