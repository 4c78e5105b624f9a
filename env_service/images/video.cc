// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <opencv2/videoio/registry.hpp>

#include "core/files/files.h"
#include "core/files/image_header.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr int kNearby = 48;  // frames that are faster to decode than to seek over

/// Frames of a video. The decoder opens with the first picture asked for, so that a dataset of many videos keeps none.
class VideoFrames : public Images {
 public:
  VideoFrames(const std::string& path, const std::string& root, double* rate)
      : path_(std::filesystem::absolute(path).string()), name_(path_below(path, root)) {
    base_ = hash_of_samples();
    open();
    frames_ = number_of_frames();
    const double fps = property(cv::CAP_PROP_FPS);
    if (rate) *rate = std::isfinite(fps) && fps > 0 ? fps : 0;
    capture_.release();
  }

  int frames() const override { return frames_; }
  std::string name(int frame) const override { return name_ + ", frame " + std::to_string(frame); }
  std::string fault(int) const override { return ""; }
  std::uint64_t fingerprint(int frame) const override {
    Sha256 sha;
    sha.add(base_);
    sha.add(static_cast<std::uint64_t>(frame));
    return sha.first_8_bytes();
  }
  void read(int frame, Bytes& bytes) override {
    if (frame < 0 || frame >= frames_) throw Error("no frame " + std::to_string(frame), name_);
    if (!capture_.isOpened()) open();
    if (!fetch(frame)) {
      capture_.release();  // begins anew with the next picture
      throw Error("cannot be decoded", name(frame), "the video is broken there");
    }
    encode_png(picture_, bytes);
  }

 private:
  void open() {
    try {
      // The processor's own decoder gives the same pictures on every machine.
      const std::vector<int> options{cv::CAP_PROP_HW_ACCELERATION, cv::VIDEO_ACCELERATION_NONE};
      if (cv::videoio_registry::hasBackend(cv::CAP_FFMPEG))
        capture_.open(path_, cv::CAP_FFMPEG, options);
      else
        capture_.open(path_, cv::CAP_ANY);
    } catch (const cv::Exception& error) {
      throw Error("the video cannot be opened: " + error.err, name_);
    }
    next_ = 0;
    if (!capture_.isOpened())
      throw Error("the video cannot be opened", name_, "broken, or of a kind that OpenCV was built without");
    const double width = property(cv::CAP_PROP_FRAME_WIDTH), height = property(cv::CAP_PROP_FRAME_HEIGHT);
    if (!(width >= 1 && height >= 1 && width * height <= static_cast<double>(kMaxPixels)))
      throw Error("its pictures are empty, or have more than " + std::to_string(kMaxPixels) + " pixels", name_);
  }

  /// Containers round, or count frames that were never written: the last frame that can be decoded counts.
  int number_of_frames() {
    const double given = property(cv::CAP_PROP_FRAME_COUNT);
    if (!(given >= 1))
      throw Error("the video does not give its number of frames", name_, "copy it into another container");
    if (given > msg::MAX_FRAMES)
      throw Error("more than " + std::to_string(msg::MAX_FRAMES) + " frames", name_, "cut the video");
    const int count = static_cast<int>(given);
    for (int frame = count - 1; frame >= std::max(0, count - 3); --frame) {
      if (fetch(frame)) return frame + 1;
      capture_.release();
      open();
    }
    throw Error("its last frames cannot be decoded; it should have " + std::to_string(count), name_,
                "the video is cut short");
  }

  double property(int which) { return capture_.get(which); }

  /// Decodes the frame into picture_. Returns false when that fails.
  bool fetch(int frame) {
    try {
      if (frame < next_ || frame > next_ + kNearby) {
        if (!capture_.set(cv::CAP_PROP_POS_FRAMES, frame)) return false;
        next_ = frame;
      }
      for (; next_ < frame; ++next_)
        if (!capture_.grab()) return false;
      ++next_;
      return capture_.read(picture_) && !picture_.empty() && picture_.depth() == CV_8U;
    } catch (const cv::Exception&) {
      return false;
    }
  }

  /// Hashes the size and 16 KiB at 64 places, which distinguishes videos without reading gigabytes.
  std::uint64_t hash_of_samples() const {
    refuse_special_file(path_);
    std::ifstream file(path_, std::ios::binary | std::ios::ate);
    if (!file) throw Error("the video cannot be read", name_);
    const auto size = static_cast<std::uint64_t>(file.tellg());
    Sha256 sha;
    sha.add(size);
    std::string block(16 << 10, '\0');
    for (std::uint64_t i = 0; i < 64; ++i) {
      const std::uint64_t last = size > block.size() ? size - block.size() : 0;
      file.clear();
      file.seekg(static_cast<std::streamoff>(last / 63 * i + last % 63 * i / 63));
      file.read(block.data(), static_cast<std::streamsize>(block.size()));
      sha.add(block.data(), static_cast<std::size_t>(file.gcount()));
      if (last == 0) break;
    }
    return sha.first_8_bytes();
  }

  std::string path_, name_;
  std::uint64_t base_ = 0;
  int frames_ = 0;
  int next_ = 0;  ///< frame that the decoder gives next
  cv::VideoCapture capture_;
  cv::Mat picture_;
};

}  // namespace

std::shared_ptr<Images> video_frames(const std::string& path, const std::string& root, double* rate) {
  return std::make_shared<VideoFrames>(path, root, rate);
}

}  // namespace citylearn
