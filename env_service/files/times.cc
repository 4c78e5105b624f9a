// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/times.h"

#include <chrono>
#include <cmath>

namespace citylearn {
namespace {

/// Takes `digits` digits from the front of `text`. Returns -1 when they are not there.
int take(std::string_view& text, std::size_t digits) {
  int number = 0;
  for (std::size_t i = 0; i < digits; ++i) {
    if (i >= text.size() || text[i] < '0' || text[i] > '9') return -1;
    number = 10 * number + (text[i] - '0');
  }
  text.remove_prefix(digits);
  return number;
}

bool skip(std::string_view& text, std::string_view any) {
  if (text.empty() || any.find(text.front()) == any.npos) return false;
  text.remove_prefix(1);
  return true;
}

}  // namespace

double read_zone(std::string_view text) {
  if (text == "Z" || text == "z") return 0;
  const bool west = text.starts_with('-');
  if (!skip(text, "+-")) return kUnknown;
  const int hours = take(text, 2);
  skip(text, ":");
  const int minutes = text.empty() ? 0 : take(text, 2);
  if (hours < 0 || hours > 14 || minutes < 0 || minutes > 59 || !text.empty()) return kUnknown;
  return (west ? -60 : 60) * (60 * hours + minutes);
}

Moment read_moment(std::string_view text) {
  using namespace std::chrono;
  while (skip(text, " \t\r\n")) continue;
  while (!text.empty() && (text.back() == '\0' || std::string_view(" \t\r\n").find(text.back()) != text.npos))
    text.remove_suffix(1);
  Moment moment{kUnknown, kUnknown};
  const int y = take(text, 4);
  skip(text, "-:/");
  const int m = take(text, 2);
  skip(text, "-:/");
  const int d = take(text, 2);
  if (y < 0 || m < 0 || d < 0) return moment;
  const year_month_day day{year{y}, month{static_cast<unsigned>(m)}, std::chrono::day{static_cast<unsigned>(d)}};
  if (!day.ok()) return moment;
  double time = 0;
  if (!text.empty()) {
    if (!skip(text, "T t")) return moment;
    const int h = take(text, 2);
    skip(text, ":");
    const int min = take(text, 2);
    int s = 0;
    if (skip(text, ":") || (!text.empty() && text[0] >= '0' && text[0] <= '9')) s = take(text, 2);
    if (h < 0 || h > 24 || min < 0 || min > 59 || s < 0 || s > 60) return moment;
    time = 3600 * h + 60 * min + s;
    if (skip(text, ".,"))
      for (double unit = 0.1; !text.empty() && text[0] >= '0' && text[0] <= '9'; unit /= 10)
        time += unit * take(text, 1);
    skip(text, " ");
    if (!text.empty() && std::isnan(moment.zone = read_zone(text))) return moment;
  }
  moment.seconds = static_cast<double>(sys_days(day).time_since_epoch().count()) * 86400 + time;
  return moment;
}

}  // namespace citylearn
