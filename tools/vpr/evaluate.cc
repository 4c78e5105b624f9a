// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/evaluate.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/wire/service.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/encoding/picture_encoder.h"
#include "env_service/geometry/plane.h"
#include "tools/lab/descriptors.h"
#include "tools/lab/programs.h"
#include "tools/vpr/report.h"

namespace citylearn::vpr {
namespace {

/// Returns the pairs of frames at most `radius` metres apart: on the map when both traversals have coordinates, else
/// along the route. Leaves out reference frames whose place is not known, and adds such query frames to `unplaced`.
GroundTruth truth_within(const Traversal& reference, const Traversal& query, double radius, std::set<int>& unplaced) {
  const auto known = [](double number) { return std::isfinite(number); };
  const bool on_map =
      std::any_of(reference.latitude.begin(), reference.latitude.end(), known) && !query.latitude.empty();
  const auto point = [&](const Traversal& traversal, int frame) {
    const auto i = static_cast<std::size_t>(frame);
    return on_map ? on_earth(traversal.latitude[i], traversal.longitude[i]) : Point{traversal.positions[i]};
  };
  Grid grid(radius);
  std::vector<int> unplaced_references;
  for (int frame = 0; frame < reference.frames; ++frame)
    if (const Point at = point(reference, frame); known(at.x))
      grid.add(at, frame);
    else
      unplaced_references.push_back(frame);
  std::vector<std::pair<int, int>> pairs;
  std::vector<Grid::Near> near;
  for (int frame = 0; frame < query.frames; ++frame)
    if (const Point at = point(query, frame); known(at.x)) {
      grid.near(at, near);
      for (const Grid::Near& one : near) pairs.push_back({one.frame, frame});
    } else {
      unplaced.insert(frame);
    }
  if (pairs.empty())
    throw Error("no frame of " + query.name + " is known to lie so near to one of " + reference.name, "--radius",
                "choose a larger one, or --tolerance in frames when positions are not known");
  GroundTruth truth = GroundTruth::by_matches(pairs, reference.frames, query.frames, 0);
  for (const int frame : unplaced_references) truth.leave_out_reference(frame);
  if (!unplaced_references.empty())
    spdlog::warn("{}: {} of {} frames have no known place and are no answers", reference.name,
                 unplaced_references.size(), reference.frames);
  return truth;
}

constexpr int kWidth = 160, kBorder = 4, kGap = 6;  // pixels: of a picture, of its frame, between frames

/// Returns a JPEG of up to `most` queries spread over the traversal, a column each: the query's picture, the most
/// similar one of the reference in a frame (green when it is right, red when it is wrong), and a right one. What does
/// not exist is left white. Both traversals must have pictures. Throws Error, Stopped.
std::string matches_jpeg(const Traversal& reference, const Traversal& query, const Answers& answers,
                         const GroundTruth& truth, int most = 12) {
  const cv::Scalar white(255, 255, 255), green(0, 160, 0), red(0, 0, 220);
  const int columns = std::min(most, query.frames);
  const cv::Mat first = lab::read_picture(query, 0);
  const int height = std::clamp(kWidth * first.rows / first.cols, 1, 2 * kWidth);
  const int across = kWidth + 2 * kBorder + kGap, down = height + 2 * kBorder + kGap;
  cv::Mat sheet(3 * down, columns * across, CV_8UC3, white);
  const auto show = [&](int row, int column, const Traversal& traversal, int frame, const cv::Scalar& colour) {
    if (frame < 0) return;
    const cv::Rect place(column * across, row * down, kWidth + 2 * kBorder, height + 2 * kBorder);
    sheet(place).setTo(colour);
    const cv::Mat inside = sheet(place)(cv::Rect(kBorder, kBorder, kWidth, height));
    scaled(lab::read_picture(traversal, frame), kWidth, height).copyTo(inside);
  };
  for (int column = 0; column < columns; ++column) {
    const int q = static_cast<int>((2 * static_cast<long>(column) + 1) * query.frames / (2 * columns));
    show(0, column, query, q, white);
    show(1, column, reference, answers.nearest[q], answers.rank[q] == 0 ? green : red);
    show(2, column, reference, truth.place(q), white);
  }
  std::vector<std::uint8_t> file;
  cv::imencode(".jpg", sheet, file);
  return {file.begin(), file.end()};
}

/// Returns a PNG of a matrix, an entry a pixel: dark to bright from the 1st to the 99th percentile of its finite
/// entries.
std::string matrix_png(const Eigen::MatrixXf& matrix) {
  std::vector<float> finite;
  for (const float value : matrix.reshaped())
    if (std::isfinite(value)) finite.push_back(value);
  float low = 0, high = 1;
  if (!finite.empty()) {
    const auto at = [&](double share) {
      const auto middle = finite.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(finite.size() - 1));
      std::nth_element(finite.begin(), middle, finite.end());
      return *middle;
    };
    low = at(0.01);
    high = at(0.99);
  }
  const float scale = high > low ? 255 / (high - low) : 0;
  cv::Mat grey, colour;
  cv::eigen2cv(matrix, grey);
  grey.convertTo(grey, CV_8U, scale, -low * scale);  // what is not finite becomes 0
  try {
    cv::applyColorMap(grey, colour, cv::COLORMAP_VIRIDIS);
    std::vector<std::uint8_t> file;
    cv::imencode(".png", colour, file);
    return {file.begin(), file.end()};
  } catch (const cv::Exception& error) {
    throw Error("the picture of the similarities cannot be made: " + error.err);
  }
}

class Evaluation {
 public:
  explicit Evaluation(const Options& options) : options_(options) {
    for (const std::string& chain : options.methods) methods_.emplace_back(chain);
    for (const std::string& name : options.centrings) centring_of(name);
    create_folder(options.output, "choose another --output");
    load();
    make_encoders();
  }

  int run() {
    bool stopped = false;
    try {
      if (!reference_.images) run_part(features_part());
      for (const auto& [name, encoder] : encoders_) run_part(encoded_part(name, *encoder));
    } catch (const lab::Stopped&) {
      stopped = true;
    }
    if (rows_.empty() && !stopped)
      throw Error("none of these is possible", "--dimension", "0 takes the descriptors as they are");
    if (!rows_.empty()) {
      std::cout << table(rows_);
      draw();
    }
    std::cerr << (stopped ? "stopped early; " : "") << rows_.size() << " rows in " << options_.output << std::endl;
    return stopped ? 130 : 0;
  }

 private:
  /// The figures are complete without the curves' pictures, which need Python and matplotlib.
  void draw() const {
    try {
      lab::run_python("vpr/recognition_page.py", {options_.output});
    } catch (const Error& error) {
      spdlog::warn("index.html and its curves not drawn: {}", error.what());
    }
  }

  void load() {
    const std::unique_ptr<Dataset> dataset = open_dataset(options_.source);
    const std::string& reference = options_.source.traversal;
    std::vector<std::string> queries = options_.queries;
    if (queries.empty())
      for (const std::string& name : dataset->names())
        if (name != reference) queries.push_back(name);
    if (queries.empty())
      throw Error("the dataset has one traversal only", "--query", "name the reference to compare it to itself");
    Selection selection = options_.source.selection;
    const std::string sibling = !selection.align.empty() ? selection.align : options_.radius > 0 ? "" : reference;
    const auto get = [&](const std::string& name) {
      selection.align = name == sibling ? "" : sibling;
      return select(*dataset, name, selection);
    };
    reference_ = get(reference);
    for (const std::string& name : queries) {
      queries_.push_back(get(name));
      if (queries_.back().dimension != reference_.dimension)
        throw Error(fmt::format("one has {} features a frame, the other {} (0: pictures)", reference_.dimension,
                                queries_.back().dimension),
                    reference + " and " + name);
      truths_.push_back(truth(queries_.back()));
    }
  }

  GroundTruth truth(const Traversal& query) const {
    std::set<int> unplaced;
    const bool by_metres = options_.radius > 0;
    GroundTruth truth = by_metres ? truth_within(reference_, query, options_.radius, unplaced)
                                  : GroundTruth::by_index(reference_.frames, query.frames, options_.tolerance);
    for (const std::vector<bool>* unmatched : {&reference_.unmatched, &query.unmatched})
      for (std::size_t i = 0; !by_metres && i < unmatched->size(); ++i)
        if ((*unmatched)[i]) unplaced.insert(static_cast<int>(i));
    for (const int frame : unplaced) truth.leave_out(frame);
    if (!unplaced.empty())
      spdlog::warn("{}: {} of {} frames have no known place and are not judged", query.name, unplaced.size(),
                   query.frames);
    return truth;
  }

  /// Makes all encoders before the first picture is encoded, so that a wrong option shows at once.
  void make_encoders() {
    if (!reference_.images) {
      if (!options_.encoders.empty())
        throw Error("dataset " + options_.source.dataset + " has features already", "--encoder", "leave it out");
      return;
    }
    auto asked = options_.encoders;
    if (asked.empty()) asked = {kDefaultEncoder};
    const auto is_asked = [&](const std::string& encoder) {
      return std::any_of(asked.begin(), asked.end(),
                         [&](const std::string& name) { return choose_encoder(name, {}).entry.name == encoder; });
    };
    for (const auto& [name, given] : options_.parameters)
      if (!given.empty() && !is_asked(name))
        throw Error("is for encoder " + name + ", which is not among --encoder",
                    "--" + name + "-" + given.begin()->first);
    for (const std::string& name : asked) {
      const auto [entry, files] = choose_encoder(name, options_.files);
      const auto given = options_.parameters.find(entry.name);
      const Parameters parameters("encoder " + name, entry.parameters,
                                  given == options_.parameters.end() ? std::map<std::string, double>() : given->second);
      encoders_.emplace_back(name, entry.create(parameters, files));
    }
  }

  /// All frames, as encoded by one encoder.
  struct Part {
    std::string label, name;
    lab::Descriptors reference;
    std::vector<lab::Descriptors> queries;
  };

  Part encoded_part(const std::string& label, Encoder& encoder) const {
    lab::fit_encoder(encoder, reference_);
    Part part{label, encoder.spec().name, lab::encode(encoder, reference_, label, options_.store), {}};
    for (const Traversal& query : queries_) part.queries.push_back(lab::encode(encoder, query, label, options_.store));
    return part;
  }

  Part features_part() const {
    Part part{"features", "features of " + options_.source.dataset, lab::features_of(reference_), {}};
    for (const Traversal& query : queries_) part.queries.push_back(lab::features_of(query));
    return part;
  }

  void run_part(const Part& part) {
    const Eigen::MatrixXf& reference = part.reference.matrix;
    const int most = Reduction::largest_dimension(reference.rows(), reference.cols());
    for (const std::string& centring : options_.centrings)
      for (const int dimension : options_.dimensions) {
        if (stop_requested()) throw lab::Stopped{};
        if (dimension > most) {
          spdlog::warn("{}: no PCA to {} dimensions, as {} are the most: left out", part.label, dimension, most);
          continue;
        }
        const Clock::time_point start = Clock::now();
        const Reduction reduction = Reduction::learn(
            reference, {.centring = centring_of(centring), .dimension = dimension, .whitening = options_.whitening});
        const Eigen::MatrixXf reduced = reduction.apply(reference);
        const double learning = seconds_since(start);
        for (std::size_t i = 0; i < queries_.size(); ++i) {
          const Clock::time_point began = Clock::now();
          const Eigen::MatrixXf query = reduction.apply(part.queries[i].matrix);
          const double encoding = part.reference.seconds + part.queries[i].seconds;
          Row row;
          row.facts = {{"encoder", part.label},       {"name", part.name},
                       {"dimension", reduced.rows()}, {"pca", dimension > 0},
                       {"centring", centring},        {"whitening", dimension > 0 ? options_.whitening : 0.0}};
          const double reducing = learning + seconds_since(began);
          for (const lab::Method& method : methods_) run_method(row, encoding, reducing, method, reduced, query, i);
        }
      }
  }

  void run_method(Row row, double encoding, double reducing, const lab::Method& method,
                  const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, std::size_t index) {
    const Clock::time_point start = Clock::now();
    const lab::Method::Result result = method.run(reference, query, truths_[index], options_.matching);
    const double seconds = reducing + seconds_since(start);
    const Answers& found = result.answers;
    const auto answerable = static_cast<double>(std::count(found.answerable.begin(), found.answerable.end(), true));
    const Interval recall = wilson_interval(recall_at(found, 1) * answerable, answerable);
    const Interval auc = auc_interval(found, options_.matching.seed);
    row.curve = precision_recall(found);
    row.facts.update({{"method", method.name()},
                      {"query", queries_[index].name},
                      {"condition", queries_[index].condition},
                      {"references", reference.cols()},
                      {"queries", found.queries()},
                      {"tolerance", options_.radius > 0 ? 0 : options_.tolerance},
                      {"radius", options_.radius},
                      {"recall_1", recall_at(found, 1)},
                      {"recall_1_interval", {recall.low, recall.high}},
                      {"recall_5", recall_at(found, 5)},
                      {"recall_10", recall_at(found, 10)},
                      {"recall_20", recall_at(found, 20)},
                      {"auc", row.curve.auc},
                      {"auc_interval", {auc.low, auc.high}},
                      {"recall_at_full_precision", row.curve.recall_at_full_precision},
                      {"encode_seconds", encoding},
                      {"seconds", seconds}});
    if (stop_requested()) throw lab::Stopped{};
    if (options_.pictures)
      write_file(options_.output + "/similarity-" + slug_of(row) + ".png", matrix_png(result.overview));
    if (options_.pictures && reference_.images) {
      row.matches = "matches-" + slug_of(row) + ".jpg";
      write_file(options_.output + "/" + row.matches, matches_jpeg(reference_, queries_[index], found, truths_[index]));
    }
    spdlog::info("{} by {} ({} numbers, centring {}), {}: first answer right {:.0f} %, AUC {:.3f}",
                 queries_[index].name, row.facts["encoder"].get<std::string>(), reference.rows(),
                 row.facts["centring"].get<std::string>(), method.name() == "nearest" ? "nearest frame" : method.name(),
                 100 * recall_at(found, 1), row.curve.auc);
    rows_.push_back(std::move(row));
    write_file(options_.output + "/results.csv", results_csv(rows_));
    write_file(options_.output + "/results.json", results_json(options_, rows_));
    write_file(options_.output + "/curves.json", curves_json(rows_));
  }

  const Options& options_;
  std::vector<lab::Method> methods_;
  std::vector<std::pair<std::string, std::unique_ptr<Encoder>>> encoders_;  // by name, as asked for
  Traversal reference_;
  std::vector<Traversal> queries_;
  std::vector<GroundTruth> truths_;
  std::vector<Row> rows_;
};

}  // namespace

int evaluate(const Options& options) { return Evaluation(options).run(); }

}  // namespace citylearn::vpr
