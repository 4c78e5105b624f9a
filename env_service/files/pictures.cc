// SPDX-License-Identifier: Apache-2.0
// Which files of a folder are the pictures of a traversal, and in which order.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <regex>
#include <set>
#include <unordered_map>
#include <unordered_set>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

using Names = std::vector<std::string>;
using Numbers = std::vector<long double>;

constexpr const char* kDigits = "0123456789";

/// Returns the decimal numbers in which alone names differ, in `texts` as they are written: "9.5" and "10.25" of
/// "cam1_9.5" and "cam1_10.25". Empty when names differ otherwise.
Numbers varying_numbers(const Names& names, Names& texts) {
  const std::string& one = names.front();
  auto begin = one.end() - one.begin();
  for (const std::string& name : names)
    begin = std::min(begin, std::mismatch(one.begin(), one.end(), name.begin(), name.end()).first - one.begin());
  auto first = static_cast<std::size_t>(begin);
  while (first > 0 && (std::isdigit(one[first - 1]) || one[first - 1] == '.')) --first;
  if (first > 0 && one[first - 1] == '-' && (first == 1 || !std::isalnum(one[first - 2]))) --first;  // a sign
  std::set<std::string> ends;
  Numbers numbers(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    const char *const at = names[i].data() + first, *const end = names[i].data() + names[i].size();
    const auto [after, error] = std::from_chars(at, end, numbers[i]);
    if (ends.emplace(after, end); ends.size() > 1 || error != std::errc() || !std::isdigit(at[*at == '-'])) return {};
    texts.emplace_back(at, after);
  }
  return numbers;
}

/// Returns whether decimals may be two counters ("1.9", "1.10"), or seconds and nanoseconds: some are padded, some not.
bool may_be_two_counters(const Names& texts) {
  std::set<std::size_t> lengths;
  bool padded = false;
  for (const std::string& text : texts) {
    const std::size_t length = text.size() - std::min(text.find('.'), text.size());
    lengths.insert(length);
    padded = padded || (length > 2 && text.back() == '0');
  }
  return padded && lengths.size() > 1;
}

/// Returns where a counter seems to have begun that went on from its highest number at a low one: its numbers lie at
/// both ends of what it can count, with one large hole between. 0 where it does not. Numbers of several widths show it
/// by the highest one alone, of a decimal, 16-bit or 32-bit counter.
std::size_t begin_of_wrapped_counter(const Names& texts, const Numbers& numbers) {
  if (numbers.empty()) return 0;
  std::size_t hole = 0;
  long double largest = 0, second = 0;
  const std::string& last = texts.back();
  bool padded = true;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    if (texts[i].find('.') != std::string::npos) return 0;
    padded = padded && texts[i].size() == texts[0].size();
    const long double gap = numbers[i] - numbers[i - 1];
    second = std::max(second, std::min(gap, largest));
    if (gap > largest) hole = i, largest = gap;
  }
  if (numbers.size() < 3 || last.size() < 2 || largest <= 10 * second) return 0;
  const bool highest = last.find_first_not_of('9') == last.npos || last == "65535" || last == "4294967295",
             ends = padded ? highest || last[last.find_first_not_of('0')] == '9' : highest && hole + 1 < numbers.size();
  return ends && numbers[0] <= numbers.back() / 10 && largest >= numbers.back() / 4 ? hole : 0;
}

/// Returns the month and year of a name in which a day comes before them, or nothing.
std::string month_after_day(const std::string& name) {
  static const std::regex form("(?:.*[^0-9])?[0-3]?[0-9][-_. ]([01]?[0-9][-_. ](?:19|20)[0-9][0-9])(?:[^0-9].*)?");
  std::smatch parts;
  return std::regex_match(name, parts, form) ? parts[1].str() : "";
}

/// Returns whether names give no order: words that differ, as hashes do; numbers of different units, or too spread for
/// times; places, as @utm@easting@northing@; days before their month; months by name; hours of two halves of a day;
/// hexadecimal numbers.
bool without_order(const Names& names, const Numbers& numbers) {
  std::set<std::string> words;
  std::size_t longest = 0;
  for (std::string name : names) {
    longest = std::max(longest, name.size());
    std::erase_if(name, [](unsigned char c) { return std::isdigit(c); });
    words.insert(std::move(name));
  }
  if (names.size() > 2 && longest > 2 && words.size() * 2 > names.size()) return true;
  static const std::regex form(
      "(?:.*[^a-z])?((?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*|am|pm)(?:[^a-z].*)?");
  std::set<std::string> months_or_halves;
  std::smatch parts;
  for (const std::string& word : words)
    if (const std::string small = lower(word); std::regex_match(small, parts, form)) months_or_halves.insert(parts[1]);
  if (month_after_day(names.front()) != month_after_day(names.back()) || months_or_halves.size() > 1) return true;
  const auto is_hexadecimal = [&](const std::string& name) {
    const std::size_t begin = name.find_last_of("-_. ") + 1, told = name.compare(begin, 2, "0x") == 0 ? 2 : 0;
    return (told || name.size() == longest) &&
           name.find_first_not_of("0123456789abcdefABCDEF", begin + told) == name.npos;
  };
  if (!std::is_sorted(names.begin(), names.end()) && std::all_of(names.begin(), names.end(), is_hexadecimal))
    return true;
  if (numbers.empty()) return names[0].starts_with("@");
  return numbers.back() > 1e19L || (numbers[0] >= 1e9L && numbers.back() > 500 * numbers[0]) ||
         (numbers[0] >= 1e13L && numbers.back() > 2 * numbers[0]);
}

/// Returns whether the first or last number in all names is a camera's: a digit that counts from 0 or 1, each beside
/// nearly all of the other numbers, as in "f_007_0" and "f_007_1".
bool has_number_of_camera(const Names& names, bool first) {
  std::set<char> cameras;
  std::unordered_set<std::string> others;
  for (std::string name : names) {
    const std::size_t at = first ? name.find_first_of(kDigits) : name.find_last_of(kDigits),
                      beside = first ? at + 1 : at - 1;
    if (at == name.npos || (beside < name.size() && std::isdigit(name[beside]))) return false;
    cameras.insert(name[at]);
    others.insert(name.erase(at, 1));
  }
  const std::size_t count = cameras.size();
  return count > 1 && *cameras.begin() <= '1' && *cameras.rbegin() - *cameras.begin() + 1 == static_cast<int>(count) &&
         9 * others.size() * count <= 10 * names.size();
}

/// Returns whether names count in two ways, as "DSC_0001" and "IMG_0001" of two cameras, or "7_left" and "7_right".
bool has_two_counters(const Names& names) {
  std::set<std::string> beginnings, numbers;
  for (std::string name : names) {
    beginnings.insert(lower(name.substr(0, name.find_first_of(kDigits))));
    std::erase_if(name, [](unsigned char c) { return !std::isdigit(c); });
    numbers.insert(std::move(name));
  }
  return (beginnings.size() > 1 && beginnings.size() * 2 <= names.size()) ||
         (names.size() > 3 && numbers.size() * 4 <= names.size() * 3) || has_number_of_camera(names, true) ||
         has_number_of_camera(names, false);
}

bool is_heif_name(const std::string& file) {
  const std::string suffix = lower(std::filesystem::path(file).extension().string());
  return suffix == ".heic" || suffix == ".heif" || suffix == ".hif";
}

/// Removes files that hold the same bytes as the one whose name theirs is made of, as programs name copies.
void leave_out_copies(const std::string& folder, Names& files) {
  static const std::regex form(
      "(?:(?:copy of|kopie von|copie de|copia de) )?(.+?)"
      "( ?\\([0-9]+\\)|[ _-]+(copy|kopie|kopia|copie|copia)( ?\\(?[0-9]+\\)?)?)?",
      std::regex::icase);
  std::unordered_map<std::string, std::string> named;  // files by stem
  for (const std::string& file : files) named.emplace(stem_of(file), file);
  Names copies;
  for (const auto& [stem, file] : named) {
    std::smatch parts;
    if (!std::regex_match(stem, parts, form) || parts[1] == stem) continue;
    const auto original = named.find(parts[1]);
    std::error_code ignored;
    if (original == named.end()) continue;
    const std::string copy = below(folder, file), of = below(folder, original->second);
    if (std::filesystem::file_size(copy, ignored) == std::filesystem::file_size(of, ignored) &&
        read_file(copy) == read_file(of))
      copies.push_back(file);
  }
  if (copies.empty()) return;
  std::sort(copies.begin(), copies.end());
  spdlog::warn("{}: {} pictures are copies of others and left out, the first {}", folder, copies.size(), copies[0]);
  std::erase_if(files, [&](const std::string& file) { return std::binary_search(copies.begin(), copies.end(), file); });
}

}  // namespace

Names picture_folders(const std::string& folder, int depth) {
  Names found;
  if (!files_in(folder, image_suffixes()).empty() || !files_in(folder, unread_image_suffixes()).empty())
    found.push_back(folder);
  for (const std::string& name : depth > 0 ? folders_in(folder) : Names())
    for (std::string& path : picture_folders(folder + "/" + name, depth - 1)) found.push_back(std::move(path));
  return found;
}

Names pictures_in(const std::string& folder, const PictureTimes& times_of) {
  Names files = files_in(folder, image_suffixes()), stems, unread = files_in(folder, unread_image_suffixes());
  std::unordered_set<std::string> read;
  for (const std::string& file : files)
    if (!is_heif_name(file)) read.insert(stem_of(file));
  const auto twice = [&](const std::string& file) { return read.contains(stem_of(file)); };  // the same picture
  std::erase_if(files, [&](const std::string& file) { return is_heif_name(file) && twice(file); });
  std::transform(files.begin(), files.end(), std::inserter(read, read.end()), stem_of);
  std::erase_if(unread, twice);
  if (!unread.empty())
    throw Error("has pictures of kinds that are not read: " + unread.front() +
                    (unread.size() > 1 ? " and " + std::to_string(unread.size() - 1) + " more" : ""),
                folder, "convert them to PNG or JPEG, or move them away");
  leave_out_copies(folder, files);
  if (files.size() < 2) return files;
  std::transform(files.begin(), files.end(), std::back_inserter(stems), stem_of);
  for (std::size_t i = 1; i < files.size(); ++i)
    if (stems[i] == stems[i - 1])
      throw Error(files[i - 1] + " and " + files[i] + " have one name", folder, "move one of them away");

  std::vector<double> times(files.size(), std::nan(""));
  if (times_of) times = times_of(files);
  const auto untimed =
      static_cast<std::size_t>(std::count_if(times.begin(), times.end(), [](double time) { return std::isnan(time); }));
  Names texts;
  const Numbers numbers = varying_numbers(stems, texts);
  std::vector<std::size_t> order(files.size());
  std::iota(order.begin(), order.end(), 0);
  std::size_t wrapped = 0;
  const bool by_number = !std::is_sorted(numbers.begin(), numbers.end());
  if (by_number) {
    if (untimed > 0 && may_be_two_counters(texts))
      throw Error("the numbers from " + files.front() + " to " + files.back() + " may be decimals or two counters",
                  folder, "rename the files, with as many digits behind each point");
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return numbers[a] < numbers[b]; });
  } else {
    wrapped = begin_of_wrapped_counter(texts, numbers);
    std::rotate(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(wrapped), order.end());
  }
  bool told = false;  // whether times say that this order is right
  if (untimed == 0) {
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return times[a] < times[b]; });
    told = times[order.front()] < times[order.back()];
  } else if (untimed * 2 <= files.size()) {
    std::vector<std::size_t> timed = order;
    std::erase_if(timed, [&](auto i) { return std::isnan(times[i]); });
    told = std::is_sorted(timed.begin(), timed.end(), [&](auto a, auto b) { return times[a] < times[b]; });
    if (!told)
      spdlog::warn(
          "{}: {} of {} pictures have no time, and names do not follow the times of the others; names order them",
          folder, untimed, files.size());
  }
  if (wrapped > 0 && !told)
    throw Error("the counter seems to have begun anew: " + files.front() + " would come before " + files[wrapped],
                folder,
                "rename those behind " + files.back() + " so that numbers go on, as " + texts[0] + " to 1" +
                    std::string(texts.back().size() - texts[0].size(), '0') + texts[0]);
  const bool unordered = without_order(stems, numbers);
  if (!told && !by_number && unordered)
    spdlog::warn("{}: the names of its pictures give no order ({}, {} ...); number them as they were recorded", folder,
                 files[0], files[1]);
  else if (!unordered && numbers.empty() && has_two_counters(stems))
    spdlog::warn("{}: its pictures count in two ways, {} to {}, and are ordered by {}: move another camera's away",
                 folder, files.front(), files.back(), told ? "time" : "name");
  Names ordered;
  for (const std::size_t i : order) ordered.push_back(files[i]);
  return ordered;
}

}  // namespace citylearn
