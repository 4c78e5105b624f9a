// SPDX-License-Identifier: Apache-2.0
// The learner's side of the protocol: finds the env_services, commands them, answers their observations and records
// their episodes. It is plain C over Cyclone DDS and the types that its compiler generates from idl/.
#ifndef SESSION_H
#define SESSION_H

#include <dds/dds.h>
#include <stdbool.h>
#include <stdint.h>

#include "action.h"
#include "episode.h"
#include "observation.h"
#include "status.h"
#include "task_settings.h"
#include "traversal.h"

enum { kStay = 0, kNext = 1, kPrevious = 2, kActions = 3 };

typedef struct EnvService EnvService;

typedef struct Policy {
  void* self;
  // Called once for each observation. Fills choice[agent] with an action that `allowed` allows.
  void (*decide)(void* self, const EnvService* env, const citylearn_msg_Observation* seen, uint8_t* choice);
  // Called once for each finished episode that ran under the env_service's present settings.
  void (*finished)(void* self, const EnvService* env, const citylearn_msg_EpisodeStat* episode);
} Policy;

// One env_service.
struct EnvService {
  char id[65];
  uint64_t incarnation;  // of the process that speaks for the id
  int64_t heard;         // when it was, nanoseconds
  uint64_t rival;        // incarnation of another process with the id; 0: none
  int64_t rival_since;   // heard all the time since, while the first was not
  uint64_t info;         // number of its newest TraversalInfo
  char traversal[65];
  uint32_t frames, dimension, agents;
  citylearn_msg_TaskSettings settings;  // last sent; settings.settings.version 0: none
  const Policy* policy;                 // acts under them; NULL when the env_service is idle
  bool in_force;                        // the env_service has confirmed the settings
  int64_t commanded;                    // when they were first sent, nanoseconds
  bool obeys_other, waiting;            // it shows somebody else's settings; that this learner waits was said
  uint64_t next_step;                   // of the observation to be answered next
  citylearn_msg_Action answer;          // the last one
  uint8_t choice[citylearn_msg_MAX_AGENTS];
  uint64_t recorded;                                          // all its episodes up to this one
  bool acknowledge;                                           // an acknowledgement is due
  int64_t next_settings, next_acknowledgement, silent_since;  // nanoseconds
  dds_entity_t observations;                                  // reader
  dds_entity_t task_settings, actions, acknowledgements;      // writers
};

typedef struct Session Session;

// All functions end the program with a clear line when they cannot continue.
Session* session_open(uint32_t domain, const char* name, const char* id);
void session_close(Session* session);
// Waits until there is an env_service on this traversal, with features.
EnvService* session_find(Session* session, const char* traversal, double seconds);
// Sends settings to an env_service, and sets the policy that acts under them (NULL for none; the caller keeps it).
// Fills in header, environment and settings id.
void session_command(Session* session, EnvService* env, citylearn_msg_TaskSettings settings, const Policy* policy);
// Handles the messages that have arrived and repeats what is due. Waits for at most 50 ms.
void session_spin(Session* session);
void fail(const char* format, ...) __attribute__((format(printf, 1, 2), noreturn));

#endif
