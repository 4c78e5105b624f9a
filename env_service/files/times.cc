// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/times.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <compare>
#include <cstdio>
#include <string>

namespace citylearn {

double read_zone(std::string_view text) {
  if (text == "Z" || text == "z") return 0;
  int hours = 0, minutes = 0, end = -1;
  const std::string zone(text);
  if (zone.size() == 3) std::sscanf(zone.c_str(), "%*1[+-]%2d%n", &hours, &end);
  if (zone.size() == 5) std::sscanf(zone.c_str(), "%*1[+-]%2d%2d%n", &hours, &minutes, &end);
  if (zone.size() == 6) std::sscanf(zone.c_str(), "%*1[+-]%2d:%2d%n", &hours, &minutes, &end);
  if (end != static_cast<int>(zone.size()) || hours < 0 || hours > 14 || minutes < 0 || minutes > 59) return kUnknown;
  return (zone[0] == '-' ? -60 : 60) * (60 * hours + minutes);
}

Moment read_moment(std::string_view given) {
  using namespace std::chrono;
  const std::string text(given);
  int y = 0, m = 0, d = 0, h = 0, min = 0, s = 0, end = 0;
  Moment moment{kUnknown, kUnknown};
  if (std::sscanf(text.c_str(), " %4d%*1[-:/]%2d%*1[-:/]%2d%n", &y, &m, &d, &end) < 3) return moment;
  const year_month_day day{year{y}, month{static_cast<unsigned>(m)}, std::chrono::day{static_cast<unsigned>(d)}};
  if (!day.ok()) return moment;
  double time = 0;
  const char* rest = text.c_str() + end;
  if (end = 0; std::sscanf(rest, "%*1[Tt ]%2d:%2d%n:%2d%n", &h, &min, &end, &s, &end) >= 2 && end > 0) {
    if (h < 0 || h > 24 || min < 0 || min > 59 || s < 0 || s > 60) return moment;
    time = 3600 * h + 60 * min + s;
    rest += end;
    if (*rest == '.' || *rest == ',')
      for (double unit = 0.1; *++rest >= '0' && *rest <= '9'; unit /= 10) time += unit * (*rest - '0');
  }
  std::string_view zone(rest);
  while (!zone.empty() && std::isspace(static_cast<unsigned char>(zone.front()))) zone.remove_prefix(1);
  while (!zone.empty() && std::isspace(static_cast<unsigned char>(zone.back()))) zone.remove_suffix(1);
  if (!zone.empty() && std::isnan(moment.zone = read_zone(zone))) return moment;
  moment.seconds = static_cast<double>(sys_days(day).time_since_epoch().count()) * 86400 + time;
  return moment;
}

std::vector<std::size_t> stray_times(const std::vector<double>& times) {
  constexpr double kStray = 3600;  // seconds
  std::vector<double> sorted = times;
  std::sort(sorted.begin(), sorted.end(), [](double a, double b) { return std::strong_order(a, b) < 0; });  // NaN last
  if (times.size() < 3 || std::is_sorted(times.begin(), times.end())) return {};
  std::size_t first = sorted.size() / 2, last = first;  // of those around the median without a gap
  while (first > 0 && sorted[first] - sorted[first - 1] < kStray) --first;
  while (last + 1 < sorted.size() && sorted[last + 1] - sorted[last] < kStray) ++last;
  std::vector<std::size_t> strays;
  for (std::size_t i = 0; i < times.size(); ++i)
    if (times[i] < sorted[first] || times[i] > sorted[last]) strays.push_back(i);
  if (strays.size() > std::max<std::size_t>(1, times.size() / 20)) strays.clear();
  return strays;
}

}  // namespace citylearn
