// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstring>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <span>
#include <string>

#include "core/dds/middleware_fastdds_api.h"
#include "core/util/types.h"

namespace citylearn::fast {

/// A sample of RawType: bytes to be written, or where to put bytes read.
struct Raw {
  std::span<const std::byte> out;
  Bytes* in = nullptr;
};

/// A type of topics that moves bytes which are CDR already.
class RawType : public dds::TopicDataType {
 public:
  RawType(const std::string& name, std::size_t max_bytes) {
#if CITYLEARN_FASTDDS_RELEASE == 2
    setName(name.c_str());
    auto_fill_type_object(false);
    auto_fill_type_information(false);
#else
    set_name(name);
#endif
    make_room(max_bytes);
  }
  /// Takes samples of so many bytes, and 3 more: other vendors pad to multiples of 4.
  void make_room(std::size_t bytes) {
    const auto size = static_cast<std::uint32_t>(bytes + 3);
#if CITYLEARN_FASTDDS_RELEASE == 2
    m_typeSize = std::max(m_typeSize, size);
#else
    max_serialized_type_size = std::max(max_serialized_type_size, size);
#endif
  }

#if CITYLEARN_FASTDDS_RELEASE == 2
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override { return write(data, *payload); }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override { return read(*payload, data); }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return size_of(data); };
  }
  void* createData() override { return new Raw; }
  void deleteData(void* data) override { delete static_cast<Raw*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
#else
  bool serialize(const void* data, rtps::SerializedPayload_t& payload, dds::DataRepresentationId_t) override {
    return write(data, payload);
  }
  bool deserialize(rtps::SerializedPayload_t& payload, void* data) override { return read(payload, data); }
  std::uint32_t calculate_serialized_size(const void* data, dds::DataRepresentationId_t) override {
    return size_of(data);
  }
  void* create_data() override { return new Raw; }
  void delete_data(void* data) override { delete static_cast<Raw*>(data); }
  bool compute_key(rtps::SerializedPayload_t&, rtps::InstanceHandle_t&, bool) override { return false; }
  bool compute_key(const void*, rtps::InstanceHandle_t&, bool) override { return false; }
#endif

 private:
  static std::uint32_t size_of(const void* data) {
    return static_cast<std::uint32_t>(static_cast<const Raw*>(data)->out.size());
  }
  static bool write(const void* data, rtps::SerializedPayload_t& payload) {
    const auto bytes = static_cast<const Raw*>(data)->out;
    if (bytes.size() > payload.max_size) return false;
    std::memcpy(payload.data, bytes.data(), bytes.size());
    payload.length = size_of(data);
    payload.encapsulation = CDR_LE;
    return true;
  }
  static bool read(const rtps::SerializedPayload_t& payload, void* data) {
    const std::byte* begin = reinterpret_cast<const std::byte*>(payload.data);
    static_cast<Raw*>(data)->in->assign(begin, begin + payload.length);
    return true;
  }
};

}  // namespace citylearn::fast
