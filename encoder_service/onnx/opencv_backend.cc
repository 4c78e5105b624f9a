// SPDX-License-Identifier: Apache-2.0
// Built where ONNX Runtime is not installed.
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <regex>

#include "core/util/error.h"
#include "encoder_service/onnx/onnx_backend.h"
#include "encoder_service/onnx/onnx_refusals.h"

namespace citylearn {
namespace {

/// OpenCV logs what it throws; our Error says it once.
class Silence {
 public:
  Silence() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~Silence() { cv::utils::logging::setLogLevel(before_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

/// Returns the innermost reason of an exception that OpenCV wrapped in others, in one line.
std::string reason_of(const std::exception& exception) {
  const auto* own = dynamic_cast<const cv::Exception*>(&exception);
  std::string text = own ? own->err : exception.what();
  static const std::regex kFrame(R"(OpenCV\([^)]*\)[^\n]*? error: \([^)]*\) )");
  std::smatch match;
  while (std::regex_search(text, match, kFrame)) text = match.suffix();
  text = one_line(text);
  // What it says goes before the function's name, or after that when it compared two numbers.
  static const std::regex kFunction("^[ >]*in function '[^']*'"), kRest("( in function '|, where >).*");
  text = std::regex_replace(std::regex_replace(text, kFunction, ""), kRest, "");
  while (!text.empty() && (text.front() == ' ' || text.front() == '>')) text.erase(0, 1);
  while (!text.empty() && text.back() == ' ') text.pop_back();
  if (text.size() > 160) text = text.substr(0, 160) + " ...";
  return text;
}

std::string import_fault(const std::exception& exception, std::int64_t opset) {
  static const std::regex kNode(R"(Node \[([^@\]]*)@?[^\]]*\]:\(([^)]*)\) parse error)");
  std::smatch match;
  const std::string text = exception.what();
  if (!std::regex_search(text, match, kNode))
    return "OpenCV cannot import it: " + reason_of(exception) + " (opset " + std::to_string(opset) + ")";
  const std::string what = one_line("layer '" + match[2].str() + "', operator " + match[1].str());
  if (text.find("Can't create layer") != std::string::npos) return "OpenCV has no such operator: " + what;
  return "OpenCV cannot import " + what + ": " + reason_of(exception);
}

/// Runs pictures one by one: OpenCV computes the shapes of a model that leaves the batch open as if it were 1.
class OpencvBackend : public OnnxBackend {
 public:
  OpencvBackend(OnnxModel model, const OnnxFile& file, std::array<int, 2> size, const std::string& where)
      : model_(std::move(model)), input_{1, 3, size[1], size[0]}, where_(where) {
    const Silence silence;
    refuse_misread_nodes(model_.bytes, input_, "", where);
    try {
      net_ = cv::dnn::readNetFromONNX(reinterpret_cast<const char*>(model_.bytes.data()), model_.bytes.size());
      net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
      net_.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
    } catch (const std::exception& exception) {
      throw Error(
          import_fault(exception, file.opset), where,
          "run it in Python by --encoder FILE.py, as docs/how-to/use-a-python-encoder.md says, or on Debian 13, "
          "where ONNX Runtime runs it; or export it as docs/how-to/use-an-onnx-encoder.md says");
    }
  }

  std::vector<std::string> layers() const override { return net_.getLayerNames(); }

  bool pools(const std::string& layer) const override {
    return net_.getLayer(net_.getLayerId(layer))->type == "Pooling";
  }

  void select(const std::string& layer) override {
    refuse_misread_nodes(model_.bytes, input_, layer_ = layer, where_);
    model_ = {};
  }

  int batch() const override { return 1; }

  cv::Mat run(const cv::Mat& input) override {
    const Silence silence;
    try {
      net_.setInput(input);
      return net_.forward(layer_);
    } catch (const std::exception& exception) {
      throw std::runtime_error(reason_of(exception));
    }
  }

 private:
  OnnxModel model_;  // until a layer is selected
  std::vector<std::int64_t> input_;
  std::string where_, layer_;
  cv::dnn::Net net_;
};

}  // namespace

std::string onnx_library() { return "OpenCV " + cv::getVersionString(); }

std::unique_ptr<OnnxBackend> make_onnx_backend(OnnxModel model, const OnnxFile& file, std::array<int, 2> size,
                                               const std::string& where) {
  return std::make_unique<OpencvBackend>(std::move(model), file, size, where);
}

}  // namespace citylearn
