// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/text_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/files/files.h"
#include "env_service/files/times.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxFields = std::size_t{1} << 26;

bool blank(char c) { return c == ' ' || c == '\t'; }

}  // namespace

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

void each_line(std::string_view text, const std::function<void(std::string_view, int)>& visit) {
  text = without_byte_order_mark(text);
  std::size_t at = 0;
  for (int number = 1; at < text.size(); ++number) {
    const std::size_t end = std::min(text.find_first_of("\r\n", at), text.size());
    visit(trimmed(text.substr(at, end - at)), number);
    at = end + (text.substr(end, 2) == "\r\n" ? 2 : 1);
  }
}

double field_number(const std::vector<std::string_view>& fields, std::size_t index) {
  if (index >= fields.size()) return kUnknown;
  double value = 0;
  const char *const begin = fields[index].data(), *const end = begin + fields[index].size();
  const auto [stop, problem] = std::from_chars(begin, end, value);
  return begin != end && problem == std::errc() && stop == end ? value : kUnknown;
}

std::string printable(std::string_view field) {
  std::string shown;
  for (const char c : field.substr(0, 20)) shown += c >= ' ' && c <= '~' ? c : '?';
  return shown;
}

/// Fields are places in the text, 8 bytes each, so that a log of a million rows takes little more than its file.
struct TextTable::Impl {
  struct Field {
    std::uint32_t begin, size;
  };
  struct Row {
    std::uint32_t line, first_field;
  };

  std::string path, text;
  char separator;
  std::vector<std::string> names;
  mutable std::vector<std::string> unused;
  std::vector<Field> fields;
  std::vector<Row> rows;

  void add_row(std::size_t begin, std::size_t end, std::uint32_t line) {
    rows.push_back({line, static_cast<std::uint32_t>(fields.size())});
    const std::string_view row = std::string_view(text).substr(0, end);  // a search must not go on to the file's end
    while (true) {
      if (fields.size() == kMaxFields)
        throw Error("more than " + std::to_string(kMaxFields) + " fields", path + ":" + std::to_string(line));
      const std::size_t stop = separator == ' ' ? row.find_first_of(" \t", begin) : row.find(separator, begin);
      const std::size_t field_end = std::min(stop, end);
      const std::string_view field = trimmed(std::string_view(text).substr(begin, field_end - begin));
      fields.push_back(
          {static_cast<std::uint32_t>(field.data() - text.data()), static_cast<std::uint32_t>(field.size())});
      if (field_end == end) return;
      begin = field_end + 1;
      if (separator == ' ')
        while (begin < end && blank(text[begin])) ++begin;
    }
  }
  int columns(std::size_t row) const {
    const std::size_t next = row + 1 < rows.size() ? rows[row + 1].first_field : fields.size();
    return static_cast<int>(next - rows[row].first_field);
  }
  std::string_view field(std::size_t row, int column) const {
    const Field& field = fields[rows[row].first_field + static_cast<std::size_t>(column)];
    return std::string_view(text).substr(field.begin, field.size);
  }
  int find(const std::string& column) const {
    std::erase(unused, column);
    const auto found = std::find(names.begin(), names.end(), column);
    if (found == names.end()) return -1;
    if (std::find(found + 1, names.end(), column) != names.end())
      throw Error("names two columns '" + column + "'", path, "rename one");
    return static_cast<int>(found - names.begin());
  }
};

TextTable::TextTable(const std::string& path, const Options& options) {
  auto impl = std::make_shared<Impl>();
  impl->path = path;
  impl->text = read_file(path, kMaxTextBytes);
  if (impl->text.starts_with("\xFF\xFE") || impl->text.starts_with("\xFE\xFF"))
    throw Error("is in UTF-16", path, "save it in UTF-8");
  impl->separator = options.separator;
  bool header = options.header;
  each_line(impl->text, [&](std::string_view row, int line) {
    if (row.empty() || row.front() == '#') return;
    const auto begin = static_cast<std::size_t>(row.data() - impl->text.data());
    impl->add_row(begin, begin + row.size(), static_cast<std::uint32_t>(line));
    if (!std::exchange(header, false)) {
      const std::size_t last = impl->rows.size() - 1, named = impl->names.size();
      if (const int found = impl->columns(last);
          named > 0 && found > static_cast<int>(named) && !impl->field(last, static_cast<int>(named)).empty())
        throw Error("has " + std::to_string(found) + " fields, the header names " + std::to_string(named),
                    path + ":" + std::to_string(line), "write decimals with a point, and no comma within a field");
      return;
    }
    for (int i = 0; i < impl->columns(0); ++i) impl->names.emplace_back(impl->field(0, i));
    impl->unused = impl->names;
    std::erase(impl->unused, "");
    impl->rows.clear();
    impl->fields.clear();
  });
  if (header) throw Error("is empty", path, "its first line should name the columns");
  impl->rows.shrink_to_fit();
  impl->fields.shrink_to_fit();
  impl_ = std::move(impl);
}

int TextTable::rows() const { return static_cast<int>(impl_->rows.size()); }
int TextTable::columns(int row) const { return impl_->columns(static_cast<std::size_t>(row)); }
bool TextTable::has(const std::string& column) const { return impl_->find(column) >= 0; }
const std::vector<std::string>& TextTable::unused() const { return impl_->unused; }
const std::string& TextTable::path() const { return impl_->path; }

std::string_view TextTable::text(int row, int column) const {
  if (column < 0 || column >= columns(row))
    fail(row, "no column " + std::to_string(column + 1) + ", there are " + std::to_string(columns(row)));
  return impl_->field(static_cast<std::size_t>(row), column);
}

std::string_view TextTable::text(int row, const std::string& column) const {
  const int index = impl_->find(column);
  if (index < 0)
    throw Error("no column '" + column + "'", impl_->path, "there are: " + joined(impl_->names, printable));
  if (index >= columns(row)) fail(row, "nothing in column '" + column + "'");
  return text(row, index);
}

double TextTable::number(int row, int column) const {
  std::string_view field = text(row, column);
  const std::string name = column < static_cast<int>(impl_->names.size())
                               ? "'" + printable(impl_->names[static_cast<std::size_t>(column)]) + "'"
                               : std::to_string(column + 1);
  if (field.empty()) fail(row, "nothing in column " + name);
  std::string_view digits = field;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);  // from_chars knows no plus
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::invalid_argument || end != digits.data() + digits.size())
    fail(row, "'" + printable(field) + "' in column " + name + " is not a number");
  if (error != std::errc() || !std::isfinite(value)) fail(row, "a number that is not finite in column " + name);
  return value;
}

double TextTable::number(int row, const std::string& column) const {
  text(row, column);
  return number(row, impl_->find(column));
}

std::string TextTable::place(int row) const {
  return impl_->path + ":" + std::to_string(impl_->rows[static_cast<std::size_t>(row)].line);
}

void TextTable::fail(int row, const std::string& what, const std::string& remedy) const {
  throw Error(what, place(row), remedy);
}

}  // namespace citylearn
