// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/image_sources.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <list>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <span>
#include <unordered_map>

#include "core/files/image_header.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "env_service/files/files.h"
#include "env_service/images/heif.h"

namespace citylearn {
namespace {

constexpr std::size_t kSampledBytes = 16 << 10;  // bytes looked at, at each end of a file

/// An open file, whose reads report what went wrong.
class File {
 public:
  explicit File(const std::string& path)
      : path_(path), file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {  // a FIFO would wait
    struct stat status {};
    if (file_ < 0 || ::fstat(file_, &status) != 0) {
      const int reason = errno;
      close();
      throw Error(reason == ENOENT ? "missing" : std::strerror(reason), path);
    }
    if (!S_ISREG(status.st_mode)) {
      close();
      throw Error("not a file", path);
    }
    size_ = static_cast<std::size_t>(status.st_size);
  }
  ~File() { close(); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  std::size_t size() const { return size_; }
  void read(std::size_t from, std::size_t count, Bytes& bytes) const {
    bytes.resize(count);
    for (std::size_t done = 0; done < count;) {
      const ssize_t got = ::pread(file_, bytes.data() + done, count - done, static_cast<off_t>(from + done));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) throw Error(got < 0 ? std::strerror(errno) : "became shorter while it was read", path_);
      done += static_cast<std::size_t>(got);
    }
  }

 private:
  void close() {
    if (file_ >= 0) ::close(file_);
    file_ = -1;
  }
  const std::string& path_;
  int file_;
  std::size_t size_ = 0;
};

/// Makes a file whose EXIF orientation is 2..8, or that is HEIF, one whose pixels lie upright.
void turn_upright(Bytes& bytes, int orientation, const std::string& name) {
  constexpr int kMirrored[] = {2, 1, -1, 0, 2, 1, -1, 0};  // cv::flip()'s code, after transposition from 5 on; 2: none
  cv::Mat picture = is_heif(bytes) ? decode_heif(bytes, name) : decode_image(bytes, name);
  if (orientation >= 5) cv::transpose(picture, picture);
  if (const int code = kMirrored[orientation - 1]; code != 2) cv::flip(picture, picture, code);
  encode_png(picture, bytes);
  if (bytes.size() > kMaxImageBytes) throw Error("too large when it is turned upright", name, "shrink the picture");
}

/// Image files of few folders: each path is its folder's index and its name, all names in one text.
class ImageFiles : public Images {
 public:
  ImageFiles(std::vector<std::string> paths, const std::string& root) : root_(root) {
    entries_.reserve(paths.size());
    std::map<std::string, std::uint32_t> known;
    Bytes head, tail;
    for (std::string& path : paths) {
      const std::size_t slash = path.rfind('/') + 1;  // 0 when there is none
      const auto [folder, added] =
          known.try_emplace(path.substr(0, slash), static_cast<std::uint32_t>(folders_.size()));
      if (added) folders_.push_back(folder->first);
      Entry entry{names_.size(), 0, folder->second, static_cast<std::uint32_t>(path.size() - slash)};
      names_.append(path, slash);
      int orientation = 1;
      std::string fault = look(path, head, tail, entry.fingerprint, orientation);
      if (orientation > 1) turned_.emplace(static_cast<int>(entries_.size()), orientation);
      if (!fault.empty()) faults_.emplace(static_cast<int>(entries_.size()), std::move(fault));
      entries_.push_back(entry);
      std::string().swap(path);
    }
    names_.shrink_to_fit();
  }

  int frames() const override { return static_cast<int>(entries_.size()); }
  std::uint64_t fingerprint(int frame) const override {
    const auto turned = turned_.find(frame);
    if (turned == turned_.end()) return at(frame).fingerprint;
    Sha256 sha;
    sha.add(at(frame).fingerprint);
    sha.add(static_cast<std::uint64_t>(turned->second));
    return sha.first_8_bytes();
  }
  std::string name(int frame) const override { return path_below(path_of(frame), root_); }
  std::string fault(int frame) const override {
    const auto found = faults_.find(frame);
    return found == faults_.end() ? "" : found->second;
  }
  void read(int frame, Bytes& bytes) override {
    const std::string path = path_of(frame);
    const File file(path);
    if (file.size() > kMaxImageBytes)
      throw Error("larger than " + std::to_string(kMaxImageBytes >> 20) + " MiB", path, "shrink the picture");
    file.read(0, file.size(), bytes);
    const bool heif = is_heif(bytes);
    if (const auto reason = heif ? std::nullopt : image_fault(bytes)) throw Error(*reason, path);
    const std::span<const std::byte> all(bytes);
    const std::size_t head = std::min(all.size(), kSampledBytes), tail = std::min(all.size() - head, kSampledBytes);
    if (fingerprint_of(all.size(), all.first(head), all.last(tail)) != at(frame).fingerprint)
      throw Error("has changed since this traversal was opened", path, "restart what reads it");
    const auto turned = turned_.find(frame);
    if (heif || turned != turned_.end()) turn_upright(bytes, heif ? 1 : turned->second, path);
  }

 private:
  struct Entry {
    std::uint64_t name;  ///< where it begins in names_
    std::uint64_t fingerprint;
    std::uint32_t folder, size;
  };

  const Entry& at(int frame) const { return entries_.at(static_cast<std::size_t>(frame)); }
  std::string path_of(int frame) const {
    const Entry& entry = at(frame);
    return folders_[entry.folder] + names_.substr(entry.name, entry.size);
  }

  static std::uint64_t fingerprint_of(std::uint64_t size, std::span<const std::byte> head,
                                      std::span<const std::byte> tail) {
    Sha256 sha;
    sha.add(size);
    sha.add(head.data(), head.size());
    sha.add(tail.data(), tail.size());
    return sha.first_8_bytes();
  }

  /// Returns the fault. A file that cannot be looked at has the fingerprint 0.
  static std::string look(const std::string& path, Bytes& head, Bytes& tail, std::uint64_t& fingerprint,
                          int& orientation) {
    try {
      const File file(path);
      file.read(0, std::min(file.size(), kSampledBytes), head);
      const std::size_t rest = std::min(file.size() - head.size(), kSampledBytes);
      file.read(file.size() - rest, rest, tail);
      fingerprint = fingerprint_of(file.size(), head, tail);
      if (file.size() > kMaxImageBytes) return "larger than " + std::to_string(kMaxImageBytes >> 20) + " MiB";
      if (is_heif(head)) return heif_fault(head, file.size());
      const std::size_t last = std::min(file.size(), kSampledBytes);
      file.read(file.size() - last, last, tail);
      std::optional<std::string> reason = image_fault(head, tail);
      if (reason && file.size() > head.size()) {  // a JPEG's size may stand behind its thumbnails
        file.read(0, file.size(), head);
        reason = image_fault(head);
        if (head.capacity() > (std::size_t{1} << 20)) Bytes().swap(head);
      }
      if (!reason) orientation = exif_of(head, tail).orientation();
      return reason.value_or("");
    } catch (const Error& error) {
      const std::string text = error.what();  // without the path, which name() gives
      return text.starts_with(path + ": ") ? text.substr(path.size() + 2) : text;
    }
  }

  std::string root_;
  std::vector<std::string> folders_;  ///< with the slash
  std::string names_;
  std::vector<Entry> entries_;
  std::map<int, std::string> faults_;
  std::map<int, int> turned_;  ///< EXIF orientation, where it is not 1
};

/// Decodes a picture as it is stored: grey or in colour, 8-bit. Throws Error, or lets out OpenCV's.
cv::Mat decode_stored(Bytes& bytes, const std::string& name) {
  read_image_header(bytes, name);  // too many pixels are refused before they are allocated
  const cv::Mat file(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
  cv::Mat picture = cv::imdecode(file, cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
  if (picture.empty()) throw Error("the picture cannot be decoded", name, "replace the file");
  return picture;
}

class Changed : public DerivedImages {
 public:
  Changed(std::shared_ptr<Images> images, std::string recipe, std::function<cv::Mat(const cv::Mat&)> change)
      : DerivedImages(std::move(images)), recipe_(std::move(recipe)), change_(std::move(change)) {}

  std::uint64_t fingerprint(int frame) const override {
    Sha256 sha;
    sha.add(images_->fingerprint(frame));
    sha.add(recipe_);
    return sha.first_8_bytes();
  }
  void read(int frame, Bytes& bytes) override {
    images_->read(frame, bytes);
    try {
      encode_png(change_(decode_stored(bytes, name(frame))), bytes);
    } catch (const cv::Exception& error) {
      throw Error(error.err, name(frame) + " (" + recipe_ + ")");
    }
  }

 private:
  std::string recipe_;
  std::function<cv::Mat(const cv::Mat&)> change_;
};

class Picked : public DerivedImages {
 public:
  Picked(std::shared_ptr<Images> images, std::vector<int> which)
      : DerivedImages(std::move(images)), which_(std::move(which)) {
    for (const int frame : which_)
      if (frame < 0 || frame >= images_->frames())
        throw Error("no frame " + std::to_string(frame) + " among " + std::to_string(images_->frames()));
  }
  int frames() const override { return static_cast<int>(which_.size()); }
  void read(int frame, Bytes& bytes) override { images_->read(of(frame), bytes); }
  std::string name(int frame) const override { return images_->name(of(frame)); }
  std::uint64_t fingerprint(int frame) const override { return images_->fingerprint(of(frame)); }
  std::string fault(int frame) const override { return images_->fault(of(frame)); }

 private:
  int of(int frame) const { return which_.at(static_cast<std::size_t>(frame)); }

  std::vector<int> which_;
};

class Joined : public Images {
 public:
  explicit Joined(std::vector<std::shared_ptr<Images>> parts) : parts_(std::move(parts)) {}
  int frames() const override {
    return std::accumulate(parts_.begin(), parts_.end(), 0, [](int sum, auto& part) { return sum + part->frames(); });
  }
  void read(int frame, Bytes& bytes) override { part(frame).read(frame, bytes); }
  std::string name(int frame) const override {
    const Images& images = part(frame);
    return images.name(frame);
  }
  std::uint64_t fingerprint(int frame) const override {
    const Images& images = part(frame);
    return images.fingerprint(frame);
  }
  std::string fault(int frame) const override {
    const Images& images = part(frame);
    return images.fault(frame);
  }

 private:
  /// Returns the part that has a frame, which becomes the frame of this part.
  Images& part(int& frame) const {
    auto at = parts_.begin();
    for (; at + 1 != parts_.end() && frame >= (*at)->frames(); ++at) frame -= (*at)->frames();
    return **at;
  }
  const std::vector<std::shared_ptr<Images>> parts_;
};

class Cached : public DerivedImages {
 public:
  Cached(std::shared_ptr<Images> images, std::size_t most) : DerivedImages(std::move(images)), most_(most) {}

  void read(int frame, Bytes& bytes) override {
    if (const auto found = places_.find(frame); found != places_.end()) {
      kept_.splice(kept_.begin(), kept_, found->second);
      bytes = kept_.front().second;
      return;
    }
    images_->read(frame, bytes);
    if (bytes.size() > most_) return;
    while (size_ + bytes.size() > most_) {
      size_ -= kept_.back().second.size();
      places_.erase(kept_.back().first);
      kept_.pop_back();
    }
    kept_.emplace_front(frame, Bytes(bytes.begin(), bytes.end()));
    places_[frame] = kept_.begin();
    size_ += bytes.size();
  }

 private:
  const std::size_t most_;
  std::size_t size_ = 0;
  std::list<std::pair<int, Bytes>> kept_;  ///< the last read first
  std::unordered_map<int, std::list<std::pair<int, Bytes>>::iterator> places_;
};

}  // namespace

std::shared_ptr<Images> image_files(std::vector<std::string> paths, const std::string& root) {
  return std::make_shared<ImageFiles>(std::move(paths), root);
}

std::shared_ptr<Images> changed(std::shared_ptr<Images> images, const std::string& recipe,
                                std::function<cv::Mat(const cv::Mat&)> change) {
  return std::make_shared<Changed>(std::move(images), recipe, std::move(change));
}

std::shared_ptr<Images> moved(std::shared_ptr<Images> images, double share) {
  return changed(std::move(images), "moved by " + std::to_string(share), [share](const cv::Mat& picture) {
    const cv::Matx23d way(1, 0, std::round(share * picture.cols), 0, 1, 0);
    cv::Mat result;
    cv::warpAffine(picture, result, way, picture.size(), cv::INTER_NEAREST, cv::BORDER_REPLICATE);
    return result;
  });
}

std::shared_ptr<Images> picked(std::shared_ptr<Images> images, std::vector<int> which) {
  return std::make_shared<Picked>(std::move(images), std::move(which));
}

std::shared_ptr<Images> joined(std::vector<std::shared_ptr<Images>> parts) {
  return std::make_shared<Joined>(std::move(parts));
}

std::shared_ptr<Images> cached(std::shared_ptr<Images> images, std::size_t most) {
  return std::make_shared<Cached>(std::move(images), most);
}

void encode_png(const cv::Mat& picture, Bytes& bytes) {
  if (picture.empty() || (picture.type() != CV_8UC1 && picture.type() != CV_8UC3))
    throw Error("a picture that is not 8-bit with 1 or 3 channels", "encoding a PNG");
  std::vector<uchar> file;
  try {
    cv::imencode(".png", picture, file, {cv::IMWRITE_PNG_COMPRESSION, 1});
  } catch (const cv::Exception& error) {
    throw Error(error.err, "encoding a PNG");
  }
  bytes.resize(file.size());
  std::memcpy(bytes.data(), file.data(), file.size());
}

cv::Mat decode_image(const Bytes& file, const std::string& where) {
  const ImageHeader header = read_image_header(file, where);
  if (const auto reason = image_fault(file)) throw Error(*reason, where, "replace the file");
  cv::Mat picture;
  try {
    picture = cv::Mat(header.format == "jpeg" ? header.height : 0, header.width, CV_8UC3);
    if (decode_jpeg(file, header, where, picture.data)) return picture;
    // OpenCV only reads from it.
    const cv::Mat bytes(1, static_cast<int>(file.size()), CV_8UC1, const_cast<std::byte*>(file.data()));
    picture = cv::imdecode(bytes, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);  // as pixels lie
  } catch (const cv::Exception& error) {
    throw Error("the picture cannot be decoded: " + error.err, where, "replace the file");
  }
  if (picture.cols != header.width || picture.rows != header.height)
    throw Error("the picture cannot be decoded", where, "replace the file");
  return picture;
}

std::string decoding_fault(Images& images, int frame, Bytes& bytes, double& brightest) {
  if (std::string fault = images.fault(frame); !fault.empty()) return fault;
  try {
    images.read(frame, bytes);
    cv::minMaxIdx(decode_image(bytes, "").reshape(1), nullptr, &brightest);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace citylearn
