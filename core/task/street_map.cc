// SPDX-License-Identifier: Apache-2.0
#include "core/task/street_map.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <tuple>

#include "core/util/error.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

template <class Number>
void arrange(std::vector<Number>& values, const std::vector<std::uint32_t>& order) {
  std::vector<Number> arranged;
  arranged.reserve(values.size());
  for (const std::uint32_t index : order) arranged.push_back(values[index]);
  values = std::move(arranged);
}

[[noreturn]] void fail_at(std::size_t link, const std::string& what) {
  throw Error(what, "street map, link " + std::to_string(link));
}

}  // namespace

std::vector<std::uint32_t> StreetMap::put_in_order() {
  if (to.size() != links() || heading.size() != links() || north.size() != places())
    throw Error("sequences differ in length", "street map");
  for (float& degrees : heading) {
    degrees = std::fmod(degrees, 360.0f);
    if (degrees < 0) degrees += 360;
    if (degrees >= 360) degrees = 0;  // of -1e-9, rounded
  }
  std::vector<std::uint32_t> order(links());
  std::iota(order.begin(), order.end(), 0u);
  if (std::all_of(heading.begin(), heading.end(), [](float degrees) { return std::isfinite(degrees); }))
    std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::tie(from[a], heading[a]) < std::tie(from[b], heading[b]);
    });
  arrange(from, order);
  arrange(to, order);
  arrange(heading, order);
  check();
  return order;
}

void StreetMap::check() const {
  if (to.size() != links() || heading.size() != links() || north.size() != places())
    throw Error("sequences differ in length", "street map");
  if (links() == 0) throw Error("has no links", "street map");
  for (std::size_t place = 0; place < places(); ++place)
    if (!std::isfinite(east[place]) || !std::isfinite(north[place]))
      throw Error("its position is not a number", "street map, place " + std::to_string(place));
  std::vector<bool> left(places());
  for (std::size_t link = 0; link < links(); ++link) {
    if (from[link] >= places() || to[link] >= places())
      fail_at(link, "from place " + std::to_string(from[link]) + " to " + std::to_string(to[link]) + " of " +
                        std::to_string(places()));
    if (from[link] == to[link]) fail_at(link, "leads from place " + std::to_string(from[link]) + " to itself");
    if (!(heading[link] >= 0 && heading[link] < 360)) fail_at(link, "its heading is not 0 to 360 degrees");
    if (link > 0 && std::tie(from[link], heading[link]) < std::tie(from[link - 1], heading[link - 1]))
      fail_at(link, "is not in order: by place, then clockwise from north");
    if (link >= kMaxLinksOfPlace && from[link - kMaxLinksOfPlace] == from[link])
      throw Error("has more than " + std::to_string(kMaxLinksOfPlace) + " links",
                  "street map, place " + std::to_string(from[link]));
    left[from[link]] = true;
  }
  for (std::size_t link = 0; link < links(); ++link)
    if (!left[to[link]]) fail_at(link, "leads to place " + std::to_string(to[link]) + ", which no link leaves");
}

std::uint64_t StreetMap::hash() const {
  Sha256 sha;
  sha.add(static_cast<std::uint64_t>(places()));
  sha.add(east);
  sha.add(north);
  for (const auto* ends : {&from, &to})
    for (const std::uint32_t place : *ends) sha.add(static_cast<std::uint64_t>(place));
  sha.add(heading);
  return sha.first_8_bytes();
}

std::vector<std::uint32_t> StreetMap::first_links() const {
  std::vector<std::uint32_t> first(places() + 1);
  for (const std::uint32_t place : from) ++first[place + 1];
  std::partial_sum(first.begin(), first.end(), first.begin());
  return first;
}

}  // namespace citylearn
