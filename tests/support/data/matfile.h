// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zlib.h>

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn::testing {

/// The one variable of a MATLAB v5 file (MAT-File Format, The MathWorks; little-endian): a real matrix of doubles or
/// bytes, compressed or not. Anything else is an Error.
class MatFile {
 public:
  explicit MatFile(const std::string& path) : path_(path) {
    const std::string file = read_file(path);
    if (file.size() < 136 || file.compare(124, 4, std::string("\0\1IM", 4)) != 0) fail("is no MATLAB v5 file");
    std::string_view rest = std::string_view(file).substr(128);
    Element element = next(rest);
    std::string inflated;
    if (element.type == kCompressed) {
      inflated = inflate(element.data);
      std::string_view inner = inflated;
      element = next(inner);
    }
    if (element.type != kMatrix || !rest.empty()) fail("does not hold just one matrix");
    read_matrix(element.data);
  }

  const std::string& name() const { return name_; }
  const Eigen::MatrixXd& matrix() const { return matrix_; }

 private:
  enum Type : std::uint32_t {
    kInt8 = 1,
    kUint8 = 2,
    kInt32 = 5,
    kUint32 = 6,
    kDouble = 9,
    kMatrix = 14,
    kCompressed = 15
  };
  struct Element {
    std::uint32_t type = 0;
    std::string_view data;
  };

  [[noreturn]] void fail(const std::string& what) const { throw Error(what, path_); }

  template <class Number>
  static Number number(std::string_view data, std::size_t index) {
    Number value;
    std::memcpy(&value, data.data() + index * sizeof(Number), sizeof(Number));
    return value;
  }

  Element next(std::string_view& rest) const {
    if (rest.size() < 8) fail("ends within an element");
    const auto tag = number<std::uint32_t>(rest, 0);
    if (tag >> 16 != 0) {  // up to four bytes, packed into the tag
      if (tag >> 16 > 4) fail("has a broken tag");
      const Element element{tag & 0xFFFF, rest.substr(4, tag >> 16)};
      rest.remove_prefix(8);
      return element;
    }
    const std::size_t size = number<std::uint32_t>(rest, 1);
    if (size > rest.size() - 8) fail("ends within an element");
    const Element element{tag, rest.substr(8, size)};
    const std::size_t padded = tag == kCompressed ? size : (size + 7) / 8 * 8;
    rest.remove_prefix(std::min(rest.size(), 8 + padded));
    return element;
  }

  std::string inflate(std::string_view data) const {
    z_stream stream{};
    if (inflateInit(&stream) != Z_OK) fail("zlib does not start");
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(data.data()));
    stream.avail_in = static_cast<uInt>(data.size());
    std::string result;
    int status = Z_OK;
    while (status == Z_OK) {
      char part[1 << 14];
      stream.next_out = reinterpret_cast<Bytef*>(part);
      stream.avail_out = sizeof(part);
      status = ::inflate(&stream, Z_NO_FLUSH);
      result.append(part, sizeof(part) - stream.avail_out);
    }
    inflateEnd(&stream);
    if (status != Z_STREAM_END) fail("has a broken compressed element");
    return result;
  }

  void read_matrix(std::string_view rest) {
    const Element flags = next(rest), sizes = next(rest), name = next(rest), values = next(rest);
    if (flags.type != kUint32 || flags.data.size() != 8 || sizes.type != kInt32 || sizes.data.size() != 8 ||
        name.type != kInt8 || !rest.empty())
      fail("holds something else than a matrix");
    const auto flag = number<std::uint32_t>(flags.data, 0);
    if ((flag & 0xFF00) != 0) fail("holds a complex, global or logical matrix");
    name_ = name.data;
    const std::int64_t rows = number<std::int32_t>(sizes.data, 0), columns = number<std::int32_t>(sizes.data, 1);
    const std::size_t width = values.type == kDouble ? 8 : 1;
    if ((values.type != kDouble && values.type != kUint8) || rows < 0 || columns < 0 ||
        values.data.size() != static_cast<std::size_t>(rows * columns) * width)
      fail("holds numbers other than doubles or bytes, or too few");
    matrix_.resize(rows, columns);
    for (Eigen::Index i = 0; i < matrix_.size(); ++i)
      matrix_.data()[i] = width == 8 ? number<double>(values.data, static_cast<std::size_t>(i))
                                     : number<std::uint8_t>(values.data, static_cast<std::size_t>(i));
  }

  std::string path_, name_;
  Eigen::MatrixXd matrix_;
};

}  // namespace citylearn::testing
