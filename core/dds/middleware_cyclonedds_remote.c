// SPDX-License-Identifier: Apache-2.0
#include "core/dds/middleware_cyclonedds_remote.h"

#include <arpa/inet.h>
#include <dds/ddsi/ddsi_domaingv.h>
#include <dds/ddsi/ddsi_entity_index.h>
#include <dds/ddsi/ddsi_proxy_participant.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <dds/ddsi/q_addrset.h>
#include <dds/ddsi/q_protocol.h>
#include <dds/ddsi/q_thread.h>
#include <string.h>

static void add(const ddsi_xlocator_t* locator, void* out) {
  struct CycloneRemote* remote = out;
  if (locator->c.kind != NN_LOCATOR_KIND_UDPv4) return;
  const unsigned char* address = locator->c.address + 12;  // the last 4 of 16 bytes are the IPv4 address
  for (size_t i = 0; i < remote->addresses; ++i)
    if (memcmp(remote->address[i], address, 4) == 0) return;
  if (remote->addresses < sizeof remote->address / sizeof remote->address[0])
    memcpy(remote->address[remote->addresses++], address, 4);
}

int cyclone_remote(const struct ddsi_sertype* type, const uint8_t guid[16], struct CycloneRemote* out) {
  const struct ddsi_domaingv* domain = ddsrt_atomic_ldvoidp(&type->gv);
  if (!domain) return 0;
  uint32_t words[4];
  memcpy(words, guid, sizeof words);
  ddsi_guid_t key;
  for (int i = 0; i < 3; ++i) key.prefix.u[i] = ntohl(words[i]);
  key.entityid.u = ntohl(words[3]);
  memset(out, 0, sizeof *out);
  // While this thread counts as awake, Cyclone frees nothing that it looks at.
  struct thread_state* const self = lookup_thread_state();
  thread_state_awake(self, domain);
  const struct ddsi_proxy_participant* remote = entidx_lookup_proxy_participant_guid(domain->entity_index, &key);
  if (remote) {
    memcpy(out->vendor, remote->vendor.id, sizeof out->vendor);
    if (remote->as_meta) addrset_forall(remote->as_meta, add, out);
    if (remote->as_default) addrset_forall(remote->as_default, add, out);
  }
  thread_state_asleep(self);
  return remote != NULL;
}
