// SPDX-License-Identifier: Apache-2.0
#include "core/dds/middleware_cyclonedds_sample.h"

#include <dds/ddsi/q_radmin.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

#if defined(__SANITIZE_THREAD__)
#include <sanitizer/tsan_interface.h>
extern "C" void AnnotateIgnoreWritesBegin(const char* file, int line);
extern "C" void AnnotateIgnoreWritesEnd(const char* file, int line);
#endif

namespace citylearn::internal {
namespace {

std::size_t padded(std::size_t size) { return (size + 3) / 4 * 4; }

}  // namespace

Sample* make_sample(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size) {
  Sample* sample = static_cast<Sample*>(std::malloc(sizeof(Sample) + padded(size)));
  if (!sample) throw std::bad_alloc();
  ddsi_serdata_init(sample, type, kind);
  sample->size = static_cast<std::uint32_t>(size);
  std::memset(sample->bytes() + size, 0, padded(size) - size);
  return sample;
}

void release_sample(ddsi_serdata* data) {
#if defined(__SANITIZE_THREAD__)
  __tsan_release(data);
  AnnotateIgnoreWritesBegin(__FILE__, __LINE__);
#endif
  ddsi_serdata_unref(data);
#if defined(__SANITIZE_THREAD__)
  AnnotateIgnoreWritesEnd(__FILE__, __LINE__);
#endif
}

namespace {

bool same_key(const ddsi_serdata*, const ddsi_serdata*) { return true; }  // keyless: one instance

void free_sample(ddsi_serdata* data) {
#if defined(__SANITIZE_THREAD__)
  __tsan_acquire(data);
#endif
  std::free(data);
}

std::uint32_t sample_size(const ddsi_serdata* data) { return as_sample(data)->size; }

ddsi_serdata* sample_from_fragments(const ddsi_sertype* type, ddsi_serdata_kind kind, const nn_rdata* fragment,
                                    std::size_t size) {
  Sample* sample = make_sample(type, kind, size);
  std::uint32_t filled = 0;
  for (; fragment; fragment = fragment->nextfrag) {
    if (fragment->maxp1 <= filled) continue;  // overlap
    const std::uint32_t skip = filled > fragment->min ? filled - fragment->min : 0;
    const std::uint32_t count = fragment->maxp1 - fragment->min - skip;
    if (fragment->min > filled || filled + std::size_t{count} > size) break;
    std::memcpy(sample->bytes() + filled, NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment)) + skip,
                count);
    filled += count;
  }
  if (filled == size) return sample;
  std::free(sample);
  return nullptr;  // Cyclone drops it
}

ddsi_serdata* sample_from_vector(const ddsi_sertype* type, ddsi_serdata_kind kind, ddsrt_msg_iovlen_t count,
                                 const ddsrt_iovec_t* parts, std::size_t size) {
  Sample* sample = make_sample(type, kind, size);
  std::size_t filled = 0;
  for (ddsrt_msg_iovlen_t i = 0; i < count && filled < size; ++i) {
    const std::size_t length = std::min<std::size_t>(parts[i].iov_len, size - filled);
    std::memcpy(sample->bytes() + filled, parts[i].iov_base, length);
    filled += length;
  }
  return sample;
}

ddsi_serdata* sample_without_data(const ddsi_sertype* type) { return make_sample(type, SDK_KEY, 4); }

ddsi_serdata* sample_from_keyhash(const ddsi_sertype* type, const ddsi_keyhash*) { return sample_without_data(type); }

ddsi_serdata* sample_from_application(const ddsi_sertype* type, ddsi_serdata_kind, const void*) {
  return sample_without_data(type);  // for unregistering only; data is written by dds_writecdr
}

void copy_out(const ddsi_serdata* data, std::size_t offset, std::size_t size, void* out) {
  std::memcpy(out, as_sample(data)->bytes() + offset, size);
}

ddsi_serdata* refer_to(const ddsi_serdata* data, std::size_t offset, std::size_t size, ddsrt_iovec_t* out) {
  out->iov_base = const_cast<std::byte*>(as_sample(data)->bytes() + offset);
  out->iov_len = size;
  return ddsi_serdata_ref(data);
}

void release(ddsi_serdata* data, const ddsrt_iovec_t*) { release_sample(data); }

bool to_application(const ddsi_serdata*, void*, void**, void*) { return false; }

ddsi_serdata* without_type(const ddsi_serdata* data) {
  Sample* sample = make_sample(data->type, SDK_KEY, 4);
  sample->type = nullptr;
  return sample;
}

bool key_to_application(const ddsi_sertype*, const ddsi_serdata*, void*, void**, void*) { return true; }

std::size_t print_sample(const ddsi_sertype* type, const ddsi_serdata*, char* text, std::size_t size) {
  return static_cast<std::size_t>(std::snprintf(text, size, "%s", type ? type->type_name : ""));
}

void no_key(const ddsi_serdata*, ddsi_keyhash* hash, bool) { std::memset(hash, 0, sizeof *hash); }

const ddsi_serdata_ops kSampleOps = [] {
  ddsi_serdata_ops ops{};
  ops.eqkey = same_key;
  ops.get_size = sample_size;
  ops.from_ser = sample_from_fragments;
  ops.from_ser_iov = sample_from_vector;
  ops.from_keyhash = sample_from_keyhash;
  ops.from_sample = sample_from_application;
  ops.to_ser = copy_out;
  ops.to_ser_ref = refer_to;
  ops.to_ser_unref = release;
  ops.to_sample = to_application;
  ops.to_untyped = without_type;
  ops.untyped_to_sample = key_to_application;
  ops.free = free_sample;
  ops.print = print_sample;
  ops.get_keyhash = no_key;
  return ops;
}();

/// A type is a name, nothing else.
const ddsi_sertype_ops kTypeOps = [] {
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = [](ddsi_sertype* type) {
    ddsi_sertype_fini(type);
    std::free(type);
  };
  ops.zero_samples = [](const ddsi_sertype*, void*, std::size_t) {};
  ops.realloc_samples = [](void**, const ddsi_sertype*, void*, std::size_t, std::size_t) {};
  ops.free_samples = [](const ddsi_sertype*, void**, std::size_t, dds_free_op_t) {};
  ops.equal = [](const ddsi_sertype*, const ddsi_sertype*) { return true; };  // the name is compared before
  ops.hash = [](const ddsi_sertype*) -> std::uint32_t { return 0; };
  ops.derive_sertype = [](const ddsi_sertype* type, dds_data_representation_id_t,
                          dds_type_consistency_enforcement_qospolicy_t) { return const_cast<ddsi_sertype*>(type); };
  return ops;
}();

}  // namespace

ddsi_sertype* make_type(const std::string& name) {
  ddsi_sertype* type = static_cast<ddsi_sertype*>(std::calloc(1, sizeof(ddsi_sertype)));
  if (!type) throw std::bad_alloc();
  ddsi_sertype_init(type, name.c_str(), &kTypeOps, &kSampleOps, true);
  type->allowed_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1;
  return type;
}

}  // namespace citylearn::internal
