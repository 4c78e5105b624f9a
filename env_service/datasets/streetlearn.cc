// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <queue>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"
#include "env_service/images/panorama.h"

namespace citylearn {
namespace {

struct Link {
  int to = 0;
  double bearing = 0, metres = 0;  // degrees clockwise from north
};
struct StreetNode {
  std::string id;
  double yaw = 0, latitude = 0, longitude = 0;  // yaw: heading of the panorama's middle column
  std::vector<Link> links;
};
struct Step {
  int node = 0;
  double heading = 0;
};

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

/// StreetLearn (Mirowski et al., NeurIPS 2018 and arXiv:1903.01292): panoramas of Manhattan and Pittsburgh, a graph.
/// Published as LevelDB files of protocol buffers; read here is the same exported as files, with the graph in the text
/// form that was published with Touchdown (Chen et al., CVPR 2019):
///   nodes.txt (or graph/nodes.txt): rows "panorama id,yaw,latitude,longitude", yaw in whole degrees
///   links.txt: rows "id,bearing,id": from the first one sees the second at that heading
///   panos/<id>.jpg (or .png): equirectangular, 2:1
///   routes.txt (optional, ours): rows "name,id,id,...": routes by way of these panoramas
/// A traversal is a route, by shortest paths (metres) from each id to the next; without routes.txt they are found:
/// "route-1" between two nodes far apart, then routes from nodes spread over the file to those farthest from them. Each
/// frame looks towards the next panorama; the last one, where the one before it looked. The view is a perspective crop
/// of 90 degrees, as in StreetLearn.
/// Unsure: which column of a panorama `yaw` is the heading of (taken to be the middle one, as Street View has it).
class StreetLearn : public FolderDataset {
 public:
  StreetLearn(const std::string& folder, const Parameters& parameters)
      : FolderDataset("streetlearn", folder, "nodes.txt, links.txt and panos"),
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

 private:
  Traversal read(const std::string& name) override {
    const auto found = std::find_if(routes_.begin(), routes_.end(), [&](auto& route) { return route.first == name; });
    std::vector<std::string> paths;
    std::vector<double> headings, latitude, longitude;
    for (const Step& step : walk(name, found->second)) {
      const StreetNode& node = nodes_[static_cast<std::size_t>(step.node)];
      const std::string file = first_file(folder_, {"panos/" + node.id + ".jpg", "panos/" + node.id + ".png"});
      paths.push_back(file.empty() ? below(folder_, "panos/" + node.id + ".jpg") : file);
      headings.push_back(step.heading - node.yaw);
      latitude.push_back(node.latitude);
      longitude.push_back(node.longitude);
    }
    Traversal traversal =
        pictured(name, cached(std::make_shared<Views>(image_files(paths, folder_), headings, view_)), folder_);
    locate(traversal, latitude, longitude);
    return traversal;
  }

  void read_graph() {
    if (read_) return;
    const std::string nodes = first_file(folder_, {"nodes.txt", "graph/nodes.txt"});
    const std::string links = first_file(folder_, {"links.txt", "graph/links.txt"});
    if (nodes.empty() || links.empty()) not_recognised("nodes.txt and links.txt in it");
    if (!is_folder(below(folder_, "panos"))) not_recognised("panos/ in it");
    nodes_.clear();
    index_.clear();
    routes_.clear();
    const TextTable node_table(nodes, {',', false});
    for (int row = 0; row < node_table.rows(); ++row) {
      if (node_table.columns(row) != 4) node_table.fail(row, "not a panorama's id, yaw, latitude and longitude");
      const StreetNode node{std::string(node_table.text(row, 0)),
                            node_table.number(row, 1),
                            node_table.number(row, 2),
                            node_table.number(row, 3),
                            {}};
      if (!index_.emplace(node.id, static_cast<int>(nodes_.size())).second)
        node_table.fail(row, "a second row for this id");
      nodes_.push_back(node);
    }
    const TextTable link_table(links, {',', false});
    for (int row = 0; row < link_table.rows(); ++row) {
      if (link_table.columns(row) != 3) link_table.fail(row, "not an id, a bearing and an id");
      StreetNode& from = nodes_[static_cast<std::size_t>(known(link_table, row, 0))];
      const int to = known(link_table, row, 2);
      const StreetNode& end = nodes_[static_cast<std::size_t>(to)];
      from.links.push_back(
          {to, link_table.number(row, 1), metres_between(from.latitude, from.longitude, end.latitude, end.longitude)});
    }
    if (const std::string path = below(folder_, "routes.txt"); is_file(path))
      read_routes(path);
    else
      find_routes();
    if (routes_.empty()) throw Error("links no two panoramas", links);
    read_ = true;
  }

  int known(const TextTable& table, int row, int column) const {
    const auto found = index_.find(std::string(table.text(row, column)));
    if (found == index_.end()) table.fail(row, "id " + std::string(table.text(row, column)) + " is not in nodes.txt");
    return found->second;
  }

  void read_routes(const std::string& path) {
    const TextTable table(path, {',', false});
    for (int row = 0; row < table.rows(); ++row) {
      if (table.columns(row) < 3) table.fail(row, "not a name and two or more ids");
      const std::string name(table.text(row, 0));
      if (std::any_of(routes_.begin(), routes_.end(), [&](auto& route) { return route.first == name; }))
        table.fail(row, "a second route " + name);
      std::vector<int> stops;
      for (int column = 1; column < table.columns(row); ++column) stops.push_back(known(table, row, column));
      routes_.emplace_back(name, stops);
    }
  }

  void find_routes() {
    const auto count = static_cast<int>(nodes_.size());
    for (int route = 0; route < wanted_ && count > 1; ++route) {
      int start = static_cast<int>(static_cast<long>(route) * count / wanted_);
      if (route == 0) start = farthest(start);
      const int end = farthest(start);
      if (end == start) continue;
      const std::vector<int> stops{start, end};
      if (std::none_of(routes_.begin(), routes_.end(), [&](auto& other) { return other.second == stops; }))
        routes_.emplace_back("route-" + std::to_string(routes_.size() + 1), stops);
    }
  }

  struct Tree {
    std::vector<double> metres;
    std::vector<Step> before;  // the node before and the heading from there
  };
  /// Returns the shortest paths from `start` (Dijkstra).
  Tree shortest(int start) const {
    Tree tree{std::vector<double>(nodes_.size(), std::numeric_limits<double>::infinity()),
              std::vector<Step>(nodes_.size(), Step{-1, 0})};
    std::priority_queue<std::pair<double, int>, std::vector<std::pair<double, int>>, std::greater<>> open;
    tree.metres[static_cast<std::size_t>(start)] = 0;
    open.emplace(0, start);
    while (!open.empty()) {
      const auto [metres, node] = open.top();
      open.pop();
      if (metres > tree.metres[static_cast<std::size_t>(node)]) continue;
      for (const Link& link : nodes_[static_cast<std::size_t>(node)].links) {
        double& best = tree.metres[static_cast<std::size_t>(link.to)];
        if (metres + link.metres >= best) continue;
        best = metres + link.metres;
        tree.before[static_cast<std::size_t>(link.to)] = {node, link.bearing};
        open.emplace(best, link.to);
      }
    }
    return tree;
  }

  int farthest(int start) const {
    const Tree tree = shortest(start);
    int best = start;
    for (std::size_t node = 0; node < nodes_.size(); ++node)
      if (std::isfinite(tree.metres[node]) && tree.metres[node] > tree.metres[static_cast<std::size_t>(best)])
        best = static_cast<int>(node);
    return best;
  }

  std::vector<Step> walk(const std::string& name, const std::vector<int>& stops) const {
    std::vector<Step> steps;
    for (std::size_t leg = 0; leg + 1 < stops.size(); ++leg) {
      const Tree tree = shortest(stops[leg]);
      std::vector<Step> back;
      for (int at = stops[leg + 1]; at != stops[leg];) {
        const Step step = tree.before[static_cast<std::size_t>(at)];
        if (step.node < 0)
          throw Error("route " + name + ": no way from " + nodes_[static_cast<std::size_t>(stops[leg])].id + " to " +
                          nodes_[static_cast<std::size_t>(stops[leg + 1])].id,
                      folder_);
        back.push_back(step);
        at = step.node;
      }
      steps.insert(steps.end(), back.rbegin(), back.rend());
    }
    if (!steps.empty()) steps.push_back({stops.back(), steps.back().heading});
    return steps;
  }

  View view_;
  int wanted_;
  bool read_ = false;
  std::vector<StreetNode> nodes_;
  std::map<std::string, int> index_;  // of nodes_, by id
  std::vector<std::pair<std::string, std::vector<int>>> routes_;
};

const DatasetRegistry::Registration streetlearn_registration({
    "streetlearn",
    "StreetLearn: routes through a graph of street panoramas, exported as files",
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
