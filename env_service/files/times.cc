// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/times.h"

#include <cctype>
#include <chrono>
#include <cmath>
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

}  // namespace citylearn
