// SPDX-License-Identifier: Apache-2.0
// The protocol of a run, as whoever learns has to speak it: finds the env_services, tells them what to do, answers
// their observations, records their episodes. Plain C over Cyclone DDS and what its compiler makes of idl/; nothing
// else.
#ifndef SESSION_H
#define SESSION_H

#include <stdbool.h>
#include <stdint.h>

#include "action.h"
#include "episode.h"
#include "observation.h"
#include "task_settings.h"
#include "traversal.h"

enum { kStay = 0, kNext = 1, kPrevious = 2, kActions = 3 };

typedef struct Seat Seat;

typedef struct Learner {
  void* self;
  // Called once for each observation. Fills choice[agent] with an action that `allowed` allows.
  void (*decide)(void* self, const Seat* seat, const citylearn_msg_Observation* seen, uint8_t* choice);
  // Called once for each finished episode that ran under the seat's present settings.
  void (*finished)(void* self, const Seat* seat, const citylearn_msg_EpisodeStat* episode);
} Learner;

// One env_service.
struct Seat {
  char id[65];
  uint64_t incarnation;  // of its running process
  char traversal[65];
  uint32_t frames, dimension, agents;
  citylearn_msg_TaskSettings settings;  // last sent; settings.settings.version 0: none
  const Learner* learner;               // acts under them; NULL: nobody has to
  bool in_force;                        // it has confirmed them
  uint64_t next_step;                   // of the observation to be answered next
  citylearn_msg_Action answer;          // the last one
  uint8_t choice[citylearn_msg_MAX_AGENTS];
  uint64_t recorded;                    // all its episodes up to this one
  bool acknowledge;                     // it has to be told so
  int64_t next_settings, silent_since;  // nanoseconds
};

typedef struct Session Session;

// All functions end the program with a clear line when something cannot go on.
Session* session_open(uint32_t domain, const char* name, const char* id);
void session_close(Session* session);
// Waits until there is an env_service on this traversal, with features.
Seat* session_find(Session* session, const char* traversal, double seconds);
// Tells a seat what to do, and who acts there; NULL where nobody has to. Header, environment and settings id are filled
// in. `learner` stays the caller's.
void session_command(Session* session, Seat* seat, citylearn_msg_TaskSettings settings, const Learner* learner);
// Handles what has come and sends again what is due. Waits for at most 50 ms.
void session_spin(Session* session);
void fail(const char* format, ...) __attribute__((format(printf, 1, 2), noreturn));

#endif
