// SPDX-License-Identifier: Apache-2.0
// What a client may change: what people write about a run.
#include <algorithm>

#include "core/files/json.h"
#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxTags = 32;
constexpr std::size_t kMaxTagBytes = 64, kMaxNoteBytes = 2000;  // bytes

/// Returns whether a text has control characters (those of ASCII) but `allowed` ones.
bool has_control(std::string_view text, std::string_view allowed = "") {
  return std::any_of(text.begin(), text.end(),
                     [&](char c) { return ((c >= 0 && c < ' ') || c == '\x7F') && allowed.find(c) == allowed.npos; });
}

/// Returns the note that a client sent; nothing when it is missing or null. Throws RequestError when it is none.
std::optional<std::string> note_of(const Json& object) {
  const auto note = object.find("note");
  if (note == object.end() || note->is_null()) return std::nullopt;
  const auto* text = note->get_ptr<const std::string*>();
  if (!text || text->size() > kMaxNoteBytes || has_control(*text, "\n\t"))
    throw RequestError(
        400, "'note' must be a text of at most " + std::to_string(kMaxNoteBytes) + " bytes without control characters");
  return *text;
}

std::vector<std::string> tags_of(const Json& json) {
  const RequestError wrong(400, "'tags' must be at most " + std::to_string(kMaxTags) + " different texts of 1 to " +
                                    std::to_string(kMaxTagBytes) +
                                    " bytes on one line, without commas, or spaces at their ends");
  if (!json.is_array() || json.size() > kMaxTags) throw wrong;
  std::vector<std::string> tags;
  for (const Json& one : json) {
    if (!one.is_string()) throw wrong;
    const auto& tag = one.get_ref<const std::string&>();
    if (tag.empty() || tag.size() > kMaxTagBytes || tag.front() == ' ' || tag.back() == ' ' || has_control(tag) ||
        tag.find(',') != tag.npos || std::find(tags.begin(), tags.end(), tag) != tags.end())
      throw wrong;
    tags.push_back(tag);
  }
  return tags;
}

}  // namespace

Answer Api::annotate(const std::string& name, const Query& query) {
  const Json wanted = object_of(query, {"tags", "note"});
  std::optional<std::vector<std::string>> tags;
  if (wanted.contains("tags")) tags = tags_of(wanted["tags"]);
  const auto note = note_of(wanted);
  if (!store_.annotate(name, tags, note)) not_found("run '" + name + "' not found (GET /api/runs lists them)");
  std::optional<RunRow> row;
  {
    BorrowedReader reader(*this);
    row = reader->run(name);
  }
  if (!row) not_found("run '" + name + "' not found (GET /api/runs lists them)");
  return json_answer(run_json(*row));
}

}  // namespace citylearn
