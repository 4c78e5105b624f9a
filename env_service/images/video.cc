// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <opencv2/core.hpp>

#include "core/files/files.h"
#include "core/files/image_header.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/files/times.h"
#include "env_service/images/film_file.h"
#include "env_service/images/image_sources.h"
#include "env_service/images/video_picture.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kDecodingVersion = 2;  // part of fingerprints; raised when films give other pictures
constexpr int kNearbyPackets = 48;             // packets that are faster to read than to seek over
constexpr int kCheckedPictures = 16;           // pictures that are decoded to see whether a film's index is right
constexpr int kMaxSearch = 1000;               // packets behind a seek among which a known key frame must be

/// A packet that a decoder can begin with. Equal fields tell it again behind a seek.
struct KeyFrame {
  std::int64_t pts, dts, position;
  int size;
  int packet;     ///< its number in the order of the file
  int frame = 0;  ///< the first frame that is shown no earlier than its picture
  bool same(const AVPacket& it) const {
    return it.pts == pts && it.dts == dts && it.pos == position && it.size == size;
  }
};

/// The video track of a film: its packets, and the pictures that the decoder makes of them. Each picture's pts is the
/// number of its packet in the file, as time stamps may be missing or come twice.
class VideoTrack {
 public:
  VideoTrack(const std::string& path, const std::string& name) : path_(path), name_(name) {
    av_log_set_level(AV_LOG_QUIET);  // errors are told in one line of our own
    open();
    const AVCodecParameters& given = *stream_->codecpar;
    if (std::int64_t{given.width} * given.height > kMaxPixels)
      throw Error("its pictures have more than " + std::to_string(kMaxPixels) + " pixels", name_);
    const AVCodec* const codec = avcodec_find_decoder(given.codec_id);
    if (!codec)
      throw Error("has " + std::string(avcodec_get_name(given.codec_id)) + " video, which FFmpeg cannot decode here",
                  name_, "convert it: ffmpeg -i FILE -c:v libx264 NEW.mp4");
    decoder_.reset(avcodec_alloc_context3(codec));
    avcodec_parameters_to_context(decoder_.get(), &given);
    decoder_->thread_count = 1;  // a broken film too gives the same pictures on every machine
    decoder_->flags |= AV_CODEC_FLAG_BITEXACT;
    decoder_->max_pixels = kMaxPixels;
    if (const int error = avcodec_open2(decoder_.get(), codec, nullptr); error < 0) fail(error);
  }

  const AVFormatContext& format() const { return *film_.format; }
  const AVStream& stream() const { return *stream_; }
  const AVPacket& packet() const { return *packet_; }
  const AVFrame& picture() const { return *picture_; }
  int next_packet() const { return next_; }
  bool damaged() const { return damaged_; }  ///< the decoder could not read a packet since the film was opened

  /// Reads the next packet of the track. Returns false at the film's end.
  bool read_packet() {
    if (pending_) return next_++, pending_ = false, true;
    int error = 0;
    do {
      av_packet_unref(packet_.get());
      error = av_read_frame(film_.format.get(), packet_.get());
      if (error < 0) break;
      empty_ += packet_->stream_index == stream_->index && packet_->size == 0;  // shows the picture before again
    } while (packet_->stream_index != stream_->index || packet_->size == 0);
    if (error < 0) {
      ends_early_ |= error != AVERROR_EOF;
      return false;
    }
    // Transport streams mark packets beside which something is missing; elsewhere the file ends in the packet.
    if (!restarts_clock() && (packet_->flags & AV_PKT_FLAG_CORRUPT)) ends_early_ = true;
    return ++next_, true;
  }

  /// Decodes the next picture. Returns false at the film's end.
  bool decode() {
    for (int broken = 0; broken < kMaxSearch;) {
      const int state = avcodec_receive_frame(decoder_.get(), picture_.get());
      if (state == 0) return true;
      if (state == AVERROR_EOF) return false;
      if (state != AVERROR(EAGAIN)) {
        ++broken;  // a broken packet gives no picture
        damaged_ = true;
        continue;
      }
      const bool more = read_packet();
      if (more) packet_->pts = packet_->dts = next_ - 1;
      const int sent = avcodec_send_packet(decoder_.get(), more ? packet_.get() : nullptr);
      damaged_ |= more && sent < 0;
    }
    return false;
  }

  /// Goes to the first packet.
  void rewind() {
    open();
    avcodec_flush_buffers(decoder_.get());
  }

  /// Goes to keys[which], or to the first packet when it is negative.
  void go_to(const std::vector<KeyFrame>& keys, int which) {
    const int packet = which < 0 ? 0 : keys[static_cast<std::size_t>(which)].packet;
    if (next_ > packet || next_ + kNearbyPackets < packet) seek(keys, which);
    while (next_ < packet && read_packet()) continue;
    avcodec_flush_buffers(decoder_.get());
  }

  /// Returns whether the container's clock may begin anywhere and start anew, as in transport and program streams.
  bool restarts_clock() const { return film_.format->iformat->flags & AVFMT_TS_DISCONT; }

  /// Throws Error when fewer packets were read than the film should have.
  void require_whole(std::size_t packets) const {
    const bool indexed = std::string(film_.format->iformat->name).starts_with("mov");
    const auto listed = static_cast<std::size_t>(indexed ? avformat_index_get_entries_count(stream_) : 0);
    if (!ends_early_ && packets + empty_ >= listed) return;
    throw Error("ends early, after " + std::to_string(packets) + " pictures" +
                    (listed > 0 ? " of " + std::to_string(listed) : ""),
                name_, "copy it again, or keep what is there: ffmpeg -i FILE NEW.mp4");
  }

  /// Returns when the film says that it began; NaN where it does not. Clocks that were never set begin before 1990.
  double began() const {
    for (const AVDictionary* told : {film_.format->metadata, stream_->metadata})
      for (const char* const name : {"com.apple.quicktime.creationdate", "creation_time"})
        if (const AVDictionaryEntry* const entry = av_dict_get(told, name, nullptr, 0))
          if (const double time = read_moment(entry->value).utc(); time > read_moment("1990-01-01").seconds)
            return time;
    return std::nan("");
  }

  /// Logs what was decided where a film leaves a choice.
  void warn_of_choices() const {
    if (tracks_ > 1)
      spdlog::warn("{}: has {} video tracks; the one of {} x {} pixels is taken", name_, tracks_,
                   stream_->codecpar->width, stream_->codecpar->height);
    const AVColorTransferCharacteristic curve = stream_->codecpar->color_trc;
    if (curve == AVCOL_TRC_ARIB_STD_B67 || curve == AVCOL_TRC_SMPTE2084)
      spdlog::warn("{}: is in HDR; its brightness is taken as it is coded", name_);
  }

 private:
  void open() {
    const int error = film_.open(path_);
    if (film_.bytes && avio_size(film_.bytes.get()) == 0) throw Error("an empty file", name_);
    if (error < 0) fail(error);
    if (const int unknown = avformat_find_stream_info(film_.format.get(), nullptr); unknown < 0) fail(unknown);
    choose_stream();
    next_ = 0;
    empty_ = 0;
    pending_ = ends_early_ = damaged_ = false;
  }

  /// Takes the first video track, one that players show if there is any. A cover picture is not a video.
  void choose_stream() {
    stream_ = nullptr;
    tracks_ = 0;
    for (unsigned i = 0; i < film_.format->nb_streams; ++i) {
      AVStream* const each = film_.format->streams[i];
      each->discard = AVDISCARD_ALL;
      if (each->codecpar->codec_type != AVMEDIA_TYPE_VIDEO || each->codecpar->width <= 0 ||
          (each->disposition & (AV_DISPOSITION_ATTACHED_PIC | AV_DISPOSITION_TIMED_THUMBNAILS)))
        continue;
      ++tracks_;
      if (!stream_ || (each->disposition & ~stream_->disposition & AV_DISPOSITION_DEFAULT)) stream_ = each;
    }
    if (!stream_) throw Error("holds no video", name_, "move it out of the folder");
    stream_->discard = AVDISCARD_DEFAULT;
  }

  void seek(const std::vector<KeyFrame>& keys, int which) {
    for (int from = which, step = 1; from >= 0; from -= step, step *= 2) {
      const KeyFrame& key = keys[static_cast<std::size_t>(from)];
      const std::int64_t time = key.dts == AV_NOPTS_VALUE ? key.pts : key.dts;
      if (av_seek_frame(film_.format.get(), stream_->index, time, AVSEEK_FLAG_BACKWARD) < 0) continue;
      pending_ = false;
      for (int searched = 0; searched < kMaxSearch && read_packet(); ++searched) {
        if (!(packet_->flags & AV_PKT_FLAG_KEY)) continue;
        const auto found =
            std::find_if(keys.begin(), keys.end(), [&](const KeyFrame& known) { return known.same(*packet_); });
        if (found == keys.end()) continue;
        if (found > keys.begin() + which) break;  // too late
        next_ = found->packet;
        pending_ = true;
        return;
      }
    }
    open();
  }

  [[noreturn]] void fail(int error) const {
    char text[AV_ERROR_MAX_STRING_SIZE];
    throw Error("the video cannot be opened: " + std::string(av_make_error_string(text, sizeof text, error)), name_,
                "broken, or of a kind that FFmpeg does not know");
  }

  const std::string path_, name_;
  FilmFile film_;
  AVStream* stream_ = nullptr;
  int tracks_ = 0;
  Libav<AVCodecContext> decoder_;
  Libav<AVPacket> packet_{av_packet_alloc()};
  Libav<AVFrame> picture_{av_frame_alloc()};
  int next_ = 0;          ///< number of the packet that is read next
  bool pending_ = false;  ///< that one is in packet_
  bool ends_early_ = false, damaged_ = false;
  std::size_t empty_ = 0;
};

/// Frames of a video. The decoder opens with the first picture asked for, so that a dataset of many videos keeps none.
class VideoFrames : public Images {
 public:
  VideoFrames(const std::string& path, const std::string& root, std::vector<double>* times, double* began)
      : path_(std::filesystem::absolute(path).string()), name_(path_below(path, root)) {
    refuse_special_file(path_);
    std::vector<double> found = read_index();
    if (times) *times = std::move(found);
    if (began) *began = track_->began();
    track_.reset();
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
    if (!track_) open();
    cv::Mat picture;
    if (fetch(frame)) picture = converter_.upright_bgr(track_->picture(), display_matrix(track_->stream()));
    if (picture.empty()) {
      track_.reset();  // begins anew with the next picture
      throw Error("cannot be decoded", name(frame), "the video is broken there");
    }
    encode_png(picture, bytes);
  }

 private:
  void open() {
    track_ = std::make_unique<VideoTrack>(path_, name_);
    last_ = -1;
    broken_ = false;
  }

  /// Numbers the pictures in the order in which they are shown: by their time stamps, of which those of the first and
  /// the last pictures are tried, or by decoding all where time stamps do not tell. Returns their times in seconds.
  std::vector<double> read_index() {
    open();
    track_->warn_of_choices();
    const AVStream& stream = track_->stream();
    const AVCodecID codec = stream.codecpar->codec_id;
    // Two fields may come in packets of their own, and AVI has no times at which pictures are shown.
    bool trusted = !(codec == AV_CODEC_ID_H264 && stream.codecpar->field_order > AV_FIELD_PROGRESSIVE) &&
                   !(stream.codecpar->video_delay > 0 && track_->format().iformat->name == std::string("avi"));
    std::vector<std::int64_t> shown_at, decoded_at;
    std::vector<bool> shown;
    Sha256 sha;  // over all that makes the pictures
    sha.add(kDecodingVersion);
    const AVCodecParameters& coding = *stream.codecpar;
    for (const int value : {int{coding.color_range}, int{coding.color_space}})
      sha.add(static_cast<std::uint64_t>(value));
    if (coding.extradata_size > 0) sha.add(coding.extradata, static_cast<std::size_t>(coding.extradata_size));
    if (const std::int32_t* const turn = display_matrix(stream)) sha.add(turn, 9 * sizeof *turn);
    std::int64_t shift = 0, step = 0, before = AV_NOPTS_VALUE;
    while (track_->read_packet()) {
      const AVPacket& packet = track_->packet();
      if (shown.size() >= 2 * std::size_t{msg::MAX_FRAMES}) too_long();
      if (packet.flags & AV_PKT_FLAG_KEY)
        keys_.push_back({packet.pts, packet.dts, packet.pos, packet.size, static_cast<int>(shown.size())});
      if (track_->restarts_clock() && packet.dts != AV_NOPTS_VALUE) {
        // Where recordings were put together, the clock goes on from the end of the one before.
        if (packet.dts + shift < before) shift = before + step - packet.dts;
        if (before != AV_NOPTS_VALUE) step = packet.dts + shift - before;
        before = packet.dts + shift;
      }
      const auto shifted = [&](std::int64_t time) { return time == AV_NOPTS_VALUE ? time : time + shift; };
      decoded_at.push_back(shifted(packet.dts));
      shown_at.push_back(shifted(packet.pts));
      const bool hidden = codec == AV_CODEC_ID_VP8 && !(packet.data[0] & 0x10);  // others refer to it
      shown.push_back(!hidden && !(packet.flags & AV_PKT_FLAG_DISCARD));
      sha.add(static_cast<std::uint64_t>(packet.pts));
      sha.add(packet.data, static_cast<std::size_t>(packet.size));
      trusted = trusted && packet.pts != AV_NOPTS_VALUE && !(codec == AV_CODEC_ID_MPEG4 && packet.size < 20);
    }
    base_ = sha.first_8_bytes();
    track_->require_whole(shown.size());
    if (!(trusted && number_by_time(shown_at, shown) && try_numbers())) number_by_decoding(shown.size());
    if (frames_ == 0) throw Error("holds no picture that can be decoded", name_);
    if (frames_ > static_cast<int>(msg::MAX_FRAMES)) too_long();
    return seconds(shown_at, decoded_at);
  }

  [[noreturn]] void too_long() const {
    throw Error("more than " + std::to_string(msg::MAX_FRAMES) + " frames", name_, "cut the video");
  }

  /// Returns false when time stamps cannot be right.
  bool number_by_time(const std::vector<std::int64_t>& shown_at, const std::vector<bool>& shown) {
    std::vector<std::size_t> order(shown.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return shown_at[a] < shown_at[b]; });
    std::vector<int> next(shown.size());
    frame_of_.assign(shown.size(), -1);
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (i > 0 && shown_at[order[i]] == shown_at[order[i - 1]]) return false;
      next[order[i]] = frames_;
      if (shown[order[i]]) frame_of_[order[i]] = frames_++;
    }
    for (KeyFrame& key : keys_) key.frame = next[static_cast<std::size_t>(key.packet)];
    return std::is_sorted(keys_.begin(), keys_.end(), [](auto& a, auto& b) { return a.frame < b.frame; });
  }

  /// Leaves out what does not come at the film's beginning, as pictures do whose references were cut off, and at its
  /// end. Returns false when others than expected come.
  bool try_numbers() {
    track_->rewind();
    int first = -1, next = 0;
    while (next - first < kCheckedPictures && track_->decode()) {
      const int frame = frame_of(track_->picture());
      if (frame < 0) continue;
      if (first < 0) first = next = frame;
      // Broken packets are frames too, which cannot be shown. Each packet of AV1 is one, and its decoder tells no
      // errors.
      const bool is_frame = track_->damaged() || track_->stream().codecpar->codec_id == AV_CODEC_ID_AV1;
      if (frame > next && is_frame) next = frame;
      if (frame != next++) return false;
    }
    if (first < 0) return false;
    for (int& frame : frame_of_) frame = std::max(frame - first, -1);
    for (KeyFrame& key : keys_) key.frame = std::max(key.frame - first, 0);
    frames_ -= first;
    int last = -1;
    for (int key = key_before(frames_ - 1), back = 0; back < 3 && last < frames_ - 1; key -= ++back) {
      track_->go_to(keys_, std::max(key, -1));
      while (track_->decode()) last = std::max(last, frame_of(track_->picture()));
    }
    if (last >= 0 && last < frames_ - 1)
      spdlog::warn("{}: the last {} pictures cannot be decoded; it may be cut short", name_, frames_ - 1 - last);
    frames_ = last + 1;
    return last >= 0;
  }

  void number_by_decoding(std::size_t packets) {
    track_->rewind();
    frames_ = 0;
    frame_of_.assign(packets, -1);
    while (track_->decode()) {
      const auto packet = static_cast<std::size_t>(track_->picture().pts);
      if (packet >= packets || frame_of_[packet] >= 0)
        throw Error("has packets of several pictures", name_, "convert it: ffmpeg -i FILE NEW.mp4");
      frame_of_[packet] = frames_++;
    }
    int last = -1;
    std::erase_if(keys_, [&](KeyFrame& key) {
      key.frame = frame_of_[static_cast<std::size_t>(key.packet)];
      return key.frame <= last || (last = key.frame, false);
    });
  }

  /// Returns the frames' times in seconds: when they are shown; else when they are decoded, in order; else by the rate.
  std::vector<double> seconds(const std::vector<std::int64_t>& shown_at, const std::vector<std::int64_t>& decoded_at) {
    const AVStream& stream = track_->stream();
    std::vector<double> result(static_cast<std::size_t>(frames_));
    for (const auto* from : {&shown_at, &decoded_at}) {
      std::vector<std::int64_t> times(result.size());
      for (std::size_t packet = 0; packet < from->size(); ++packet)
        if (const int frame = frame_of_[packet]; frame >= 0 && frame < frames_)
          times[static_cast<std::size_t>(frame)] = (*from)[packet];
      if (from == &decoded_at) std::sort(times.begin(), times.end());
      if (!std::is_sorted(times.begin(), times.end()) || times.front() == AV_NOPTS_VALUE) continue;
      const std::int64_t origin = track_->restarts_clock() ? times.front() : 0;
      std::transform(times.begin(), times.end(), result.begin(),
                     [&](std::int64_t time) { return static_cast<double>(time - origin) * av_q2d(stream.time_base); });
      const double length = static_cast<double>(track_->format().duration) / AV_TIME_BASE;
      if (result.back() < 0.9 * length - 1)
        spdlog::warn("{}: its pictures end after {:.1f} of {:.1f} s; it may be cut short", name_, result.back(),
                     length);
      return result;
    }
    if (stream.avg_frame_rate.num <= 0 || stream.avg_frame_rate.den <= 0) return {};
    for (std::size_t i = 0; i < result.size(); ++i) result[i] = static_cast<double>(i) / av_q2d(stream.avg_frame_rate);
    return result;
  }

  /// Returns the frame of a decoded picture; -1 when it is not a frame.
  int frame_of(const AVFrame& picture) const {
    const auto packet = static_cast<std::size_t>(picture.pts);
    return packet < frame_of_.size() ? frame_of_[packet] : -1;
  }

  /// Returns the index of the last key frame that is shown no later than the frame; -1 when there is none.
  int key_before(int frame) const {
    const auto after = std::upper_bound(keys_.begin(), keys_.end(), frame,
                                        [](int wanted, const KeyFrame& key) { return wanted < key.frame; });
    return static_cast<int>(after - keys_.begin()) - 1;
  }

  /// Decodes the frame. Returns false when that fails.
  bool fetch(int frame) {
    const int before = key_before(frame);
    const bool passed = before < 0 || keys_[static_cast<std::size_t>(before)].packet <= track_->next_packet();
    if ((frame == last_ + 1 || (last_ >= 0 && frame > last_ && passed)) && decode_until(frame)) return true;
    // A picture may refer to some before a key frame, and pictures behind one need not be whole at once.
    for (int back = 0; back < kCheckedPictures; back = 2 * back + 1) {
      const int begin = std::max(before - back, -1);
      track_->go_to(keys_, begin);
      last_ = -1;
      broken_ = false;
      intra_ = begin <= 0 || back > 1;
      if (decode_until(frame) && intra_) return true;
      if (begin < 0 || (last_ == frame && back > 1)) break;  // damaged in the file, not by where decoding began
    }
    return false;
  }

  bool decode_until(int frame) {
    while (track_->decode()) {
      const AVFrame& picture = track_->picture();
      const bool alone = picture.pict_type == AV_PICTURE_TYPE_I || picture.pict_type == AV_PICTURE_TYPE_NONE;
      intra_ |= alone;
      const int now = frame_of(picture);
      if (now < 0) continue;
      const bool lost = last_ >= 0 && now > last_ + 1;  // the one before has no picture
      broken_ = picture.decode_error_flags != 0 || (!alone && (broken_ || lost));
      last_ = now;
      if (now == frame) return !broken_;
      if (now > frame + kCheckedPictures) break;
    }
    return false;
  }

  std::string path_, name_;
  std::uint64_t base_ = 0;
  int frames_ = 0;
  int last_ = -1;              ///< frame that was decoded last; -1 before the first
  bool intra_ = false;         ///< a picture of its own, which refers to no other, was decoded since the last seek
  bool broken_ = false;        ///< the picture that was decoded last is damaged, or refers to one that is
  std::vector<int> frame_of_;  ///< of each packet; -1 when it shows none
  std::vector<KeyFrame> keys_;
  std::unique_ptr<VideoTrack> track_;
  PictureConverter converter_;
};

}  // namespace

std::shared_ptr<Images> video_frames(const std::string& path, const std::string& root, std::vector<double>* times,
                                     double* began) {
  return std::make_shared<VideoFrames>(path, root, times, began);
}

}  // namespace citylearn
