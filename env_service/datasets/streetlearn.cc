// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>
#include <span>
#include <unordered_map>

#include "core/files/image_header.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/images/image_sources.h"
#include "env_service/images/panorama.h"
#include "env_service/traversal/street_views.h"

namespace citylearn {
namespace {

/// Crops of panoramas, each at its own heading.
class Views : public DerivedImages {
 public:
  Views(std::shared_ptr<Images> panoramas, std::vector<double> headings, View view)
      : DerivedImages(std::move(panoramas)), headings_(std::move(headings)), view_(view) {}

  void read(int frame, Bytes& bytes) override {
    images_->read(frame, panorama_);
    View view = view_;
    view.heading = headings_[static_cast<std::size_t>(frame)];
    encode_png(crop_panorama(decode_image(panorama_, images_->name(frame)), view), bytes);
  }
  std::uint64_t fingerprint(int frame) const override {
    std::uint64_t hash = images_->fingerprint(frame);
    for (const double value :
         {headings_[static_cast<std::size_t>(frame)], view_.field, static_cast<double>(view_.size)}) {
      std::uint64_t bits = 0;
      std::memcpy(&bits, &value, sizeof bits);
      for (int byte = 0; byte < 8; ++byte) hash = (hash ^ (bits >> (8 * byte) & 0xff)) * 1099511628211u;  // FNV-1a
    }
    return hash;
  }

 private:
  std::vector<double> headings_;  // of the view within the panorama: 0 is its middle column
  View view_;
  Bytes panorama_;
};

/// Panoramas of StreetLearn as it is published. Each is looked at once, and read again when it is wanted. Of a `city`,
/// which has tens of gigabytes, none is looked at: its ids name the pictures, once and for all.
class Panoramas : public Images {
 public:
  Panoramas(std::shared_ptr<const LevelDb> database, std::vector<std::string> ids, bool city)
      : database_(std::move(database)), ids_(std::move(ids)) {
    for (const std::string& id : ids_) {
      const auto [entry, added] = entries_.try_emplace(id);
      try {
        if (added) entry->second.fingerprint = sha_of(city ? id : read(id));
      } catch (const Error& error) {
        entry->second.fault = error.what();
      }
    }
    std::string().swap(panorama_);
  }
  int frames() const override { return static_cast<int>(ids_.size()); }
  std::string name(int frame) const override { return "panorama " + at(frame); }
  std::uint64_t fingerprint(int frame) const override { return entries_.at(at(frame)).fingerprint; }
  std::string fault(int frame) const override { return entries_.at(at(frame)).fault; }
  void read(int frame, Bytes& bytes) override {
    const std::string_view picture = read(at(frame));
    const auto* const first = reinterpret_cast<const std::byte*>(picture.data());
    bytes.assign(first, first + picture.size());
  }

 private:
  struct Entry {
    std::uint64_t fingerprint = 0;
    std::string fault;
  };
  const std::string& at(int frame) const { return ids_.at(static_cast<std::size_t>(frame)); }
  static std::uint64_t sha_of(std::string_view picture) {
    Sha256 sha;
    sha.add(picture.data(), picture.size());
    return sha.first_8_bytes();
  }
  /// Returns the panorama's picture, which lies in panorama_.
  std::string_view read(const std::string& id) {
    const std::string where = below(database_->folder(), id);
    if (!database_->read(id, panorama_)) throw Error("has no panorama of this key", where, "copy the folder again");
    const std::string_view picture = picture_of_panorama(panorama_, where);
    if (picture.size() > kMaxImageBytes) throw Error("has a picture larger than 64 MiB", where);
    const std::span<const char> chars(picture);
    if (const auto fault = image_fault(std::as_bytes(chars)))
      throw Error("has a picture with a fault: " + *fault, where);
    return picture;
  }
  std::shared_ptr<const LevelDb> database_;
  std::vector<std::string> ids_;
  std::unordered_map<std::string, Entry> entries_;
  std::string panorama_;  // a buffer
};

/// StreetLearn (Mirowski et al., NeurIPS 2018 and arXiv:1903.01292): panoramas of Manhattan and Pittsburgh, a graph.
/// Read as it is published, a LevelDB of protocol buffers (streetlearn.proto): key "panos_connectivity" is the graph,
/// every other key is a panorama's id, with its JPEG. Roll and pitch are not applied. Also read is the same exported as
/// files, with the graph in the text form that was published with Touchdown (Chen et al., CVPR 2019):
///   nodes.txt (or graph/nodes.txt): rows "panorama id,yaw,latitude,longitude", yaw in whole degrees
///   links.txt: rows "id,bearing,id": from the first one sees the second at that heading
///   panos/<id>.jpg (or .png): equirectangular, 2:1
/// Beside either may lie
///   routes.txt (ours): rows "name,id,id,...": routes by way of these panoramas
/// A traversal is a route, by shortest paths (metres) from each id to the next; without routes.txt they are found:
/// "route-1" between two places far apart, then routes from places spread over the map to those farthest from them.
/// Each frame looks towards the next panorama; the last one, where the one before it looked. The view is a perspective
/// crop of 90 degrees, as in StreetLearn. Under a rule of streets the only traversal is the whole map, "streets", of
/// which frame i looks from the place of state i to where that state faces. The middle column of a panorama looks where
/// `yaw`, or heading_deg, says.
class StreetLearn : public FolderDataset {
 public:
  StreetLearn(const std::string& folder, const Parameters& parameters)
      : FolderDataset("streetlearn", folder, "a LevelDB, or nodes.txt, links.txt and panos"),
        view_{0, parameters["fov"], parameters.integer("size")},
        wanted_(parameters.integer("routes")) {}

  std::vector<std::string> names() override {
    read_graph();
    std::vector<std::string> found;
    for (const auto& [name, stops] : routes_) found.push_back(name);
    return found;
  }

  std::string condition(const std::string&) override { return "day"; }
  Correspondence correspondence() const override { return Correspondence::kGps; }
  std::shared_ptr<const StreetGraph> streets() override {
    read_graph();
    return graph_;
  }

 private:
  Traversal read(const std::string& name) override {
    if (on_streets()) return read_streets(name);
    const auto found = std::find_if(routes_.begin(), routes_.end(), [&](auto& route) { return route.first == name; });
    std::vector<std::string> ids;
    std::vector<double> headings, latitude, longitude;
    for (const StreetStep& step : graph_->walk(found->second, below(folder_, "route " + name))) {
      const StreetPlace& place = graph_->places()[static_cast<std::size_t>(step.place)];
      ids.push_back(place.id);
      headings.push_back(step.heading - place.yaw);
      latitude.push_back(place.latitude);
      longitude.push_back(place.longitude);
    }
    Traversal traversal = viewed(name, panoramas(std::move(ids)), std::move(headings));
    locate(traversal, latitude, longitude);
    return traversal;
  }

  /// Returns what is seen in each state of the map.
  Traversal read_streets(const std::string& name) const {
    std::vector<std::uint32_t> rows;
    const auto map = std::make_shared<const StreetMap>(graph_->map(rows));
    const StateMap states(*map, *rule_, msg::MAX_FRAMES);
    std::vector<std::string> ids;
    for (const StreetPlace& place : graph_->places()) ids.push_back(place.id);
    std::vector<int> which;
    std::vector<double> headings;
    for (int state = 0; state < states.states(); ++state) {
      which.push_back(states.place(state));
      headings.push_back(static_cast<double>(states.heading(state)) -
                         graph_->places()[static_cast<std::size_t>(which.back())].yaw);
    }
    Traversal traversal = viewed(name, picked(panoramas(std::move(ids)), std::move(which)), std::move(headings));
    set_streets(traversal, *graph_, map, *rule_, states);
    return traversal;
  }

  Traversal viewed(const std::string& name, std::shared_ptr<Images> panoramas, std::vector<double> headings) const {
    return pictured(name, cached(std::make_shared<Views>(std::move(panoramas), std::move(headings), view_)), folder_);
  }

  std::shared_ptr<Images> panoramas(std::vector<std::string> ids) const {
    if (database_) return std::make_shared<Panoramas>(database_, std::move(ids), on_streets());
    for (std::string& id : ids) {
      const std::string jpeg = "panos/" + id + ".jpg", file = first_file(folder_, {jpeg, "panos/" + id + ".png"});
      id = file.empty() ? below(folder_, jpeg) : file;
    }
    return image_files(std::move(ids), folder_);
  }

  void read_graph() {
    if (read_) return;
    routes_.clear();
    if (LevelDb::is_in(folder_)) {
      database_ = std::make_shared<LevelDb>(folder_);
      graph_ = std::make_shared<const StreetGraph>(StreetGraph::from_leveldb(*database_));
    } else {
      if (is_folder(below(folder_, "panos"))) graph_ = StreetGraph::find_in(folder_);
      if (!graph_) not_recognised("nodes.txt, links.txt and panos/ in it");
    }
    if (on_streets())
      routes_.emplace_back("streets", std::vector<int>());
    else if (const std::string path = below(folder_, "routes.txt"); is_file(path))
      read_routes(path);
    else
      find_routes();
    if (routes_.empty()) throw Error("has no route", folder_, "write routes.txt: rows of a name and two or more ids");
    read_ = true;
  }

  void read_routes(const std::string& path) {
    const TextTable table(path, {',', false});
    for (int row = 0; row < table.rows(); ++row) {
      if (table.columns(row) < 3) table.fail(row, "not a name and two or more ids");
      const std::string name(table.text(row, 0));
      if (std::any_of(routes_.begin(), routes_.end(), [&](auto& route) { return route.first == name; }))
        table.fail(row, "a second route " + name);
      std::vector<int> stops;
      for (int column = 1; column < table.columns(row); ++column) {
        const std::string id(table.text(row, column));
        stops.push_back(graph_->find(id));
        if (stops.back() < 0) table.fail(row, "id " + printable(id) + " is not a panorama of the map");
      }
      routes_.emplace_back(name, stops);
    }
  }

  void find_routes() {
    const auto count = static_cast<int>(graph_->places().size());
    for (int route = 0; route < wanted_ && count > 1; ++route) {
      int start = static_cast<int>(static_cast<long>(route) * count / wanted_);
      if (route == 0) start = graph_->farthest(start);
      const int end = graph_->farthest(start);
      if (end == start) continue;
      const std::vector<int> stops{start, end};
      if (std::none_of(routes_.begin(), routes_.end(), [&](auto& other) { return other.second == stops; }))
        routes_.emplace_back("route-" + std::to_string(routes_.size() + 1), stops);
    }
  }

  View view_;
  int wanted_;
  bool read_ = false;
  std::shared_ptr<const LevelDb> database_;  // none: read from files
  std::shared_ptr<const StreetGraph> graph_;
  std::vector<std::pair<std::string, std::vector<int>>> routes_;
};

const DatasetRegistry::Registration streetlearn_registration({
    "streetlearn",
    "StreetLearn: routes through a graph of street panoramas, a LevelDB or files; with --rule street traversal "
    "streets, the whole graph",
    {{"fov", "field of view of the crop, degrees", 90, 30, 120},
     {"size", "width and height of the crop, pixels", 224, 84, 512, true},
     {"routes", "number of routes to find when there is no routes.txt", 4, 1, 64, true}},
    open_folder<StreetLearn>,
    {},
    {{"paper",
      "Mirowski et al.: Learning to Navigate in Cities Without a Map, NeurIPS 2018; The StreetLearn Environment "
      "and Dataset, arXiv:1903.01292"},
     {"address", "https://sites.google.com/view/streetlearn"},
     {"licence", "by agreement with the authors (Google Street View imagery); free for research"},
     {"size", "114,000 panoramas, in two LevelDB files: Manhattan and Pittsburgh"}},
});

}  // namespace
}  // namespace citylearn
