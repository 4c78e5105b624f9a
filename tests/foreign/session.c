// SPDX-License-Identifier: Apache-2.0
#include "session.h"

#include <dds/dds.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { kMaxEnvServices = 32 };

static const int64_t kSettingsResendInterval = DDS_MSECS(100);
static const int64_t kRefused = DDS_SECS(10);  // without confirmation of settings
static const int64_t kSilence = DDS_SECS(30);  // of an env_service that is not idle
static const int64_t kGone = DDS_SECS(3);      // a process that was silent for so long counts as gone,
static const int64_t kHandover = DDS_SECS(2);  // or for so long, if another one with its id was heard all that time
static const int64_t kHeartbeat = DDS_SECS(1);

struct Session {
  dds_entity_t domain, participant, waitset;
  dds_entity_t infos, episodes;  // readers
  dds_entity_t heartbeats[2];    // writers: on the learner's own topic, on that of all
  dds_entity_t end, ending;      // of the heartbeats: a condition, its waitset
  pthread_t heart;
  uint64_t sent_settings, sent_actions, sent_acknowledgements;  // counts, for the headers
  char name[65], id[65];
  uint64_t incarnation;
  uint32_t version;  // of the settings sent last
  EnvService envs[kMaxEnvServices];
  int count;
};

void fail(const char* format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fputs("foreign_learner: ", stderr);
  vfprintf(stderr, format, arguments);
  fputc('\n', stderr);
  va_end(arguments);
  exit(1);
}

static dds_entity_t require(dds_return_t result, const char* what) {
  if (result < 0) fail("cannot %s: %s", what, dds_strretcode(-result));
  return result;
}

// Every topic is RELIABLE, TRANSIENT_LOCAL, KEEP_LAST, in XCDR1; a reader is deep, as all writers share its history.
static dds_qos_t* quality(int32_t depth) {
  dds_qos_t* qos = dds_create_qos();
  const dds_data_representation_id_t representation = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos, 1, &representation);
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_durability_service(qos, 0, DDS_HISTORY_KEEP_LAST, depth, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED,
                              DDS_LENGTH_UNLIMITED);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, depth);
  dds_qset_writer_data_lifecycle(qos, false);
  return qos;
}

static dds_entity_t endpoint(Session* session, const dds_topic_descriptor_t* type, const char* name, bool writer,
                             int32_t depth) {
  const dds_entity_t topic = require(dds_create_topic(session->participant, type, name, NULL, NULL), "create a topic");
  dds_qos_t* qos = quality(depth);
  const dds_entity_t entity = writer ? dds_create_writer(session->participant, topic, qos, NULL)
                                     : dds_create_reader(session->participant, topic, qos, NULL);
  dds_delete_qos(qos);
  require(entity, "create a reader or writer");
  if (writer) return entity;
  const dds_entity_t condition = require(dds_create_readcondition(entity, DDS_ANY_STATE), "create a condition");
  require(dds_waitset_attach(session->waitset, condition, entity), "wait for a reader");
  return entity;
}

// A name as it may stand in the name of a topic.
static const char* escaped(const char* name, char* text) {
  char* to = text;
  for (; *name; ++name) {
    const char code = *name == '-' ? 'm' : *name == '.' ? 'd' : *name == '_' ? 'u' : 0;
    *to++ = code ? '_' : *name;
    if (code) *to++ = code;
  }
  *to = 0;
  return text;
}

static void stamp(const Session* session, citylearn_msg_Header* header, uint64_t number) {
  header->protocol = citylearn_msg_PROTOCOL;
  memcpy(header->session, session->name, sizeof header->session);
  memcpy(header->sender, session->id, sizeof header->sender);
  header->incarnation = session->incarnation;
  header->message = number;
}

// Shows that the learner lives, however long it computes between two steps: an env_service gives a learner that is
// silent to the next one that asks. A thread of its own.
static void* send_heartbeats(void* argument) {
  Session* session = argument;
  citylearn_msg_ServiceStatus status;
  memset(&status, 0, sizeof status);
  strcpy(status.service, "policy_service");
  strcpy(status.middleware, "cyclonedds");
  strcpy(status.activity, "learning by counting");
  gethostname(status.host, sizeof status.host - 1);
  status.process = (uint32_t)getpid();
  status.service_state = citylearn_msg_RUNNING;
  const int64_t start = dds_time();
  bool ends = false;
  for (uint64_t number = 1;; ++number) {
    if (ends) status.service_state = citylearn_msg_STOPPING;  // the next one need not wait
    stamp(session, &status.header, number);
    status.uptime = (double)(dds_time() - start) / 1e9;
    for (int i = 0; i < 2; ++i) require(dds_write(session->heartbeats[i], &status), "send a heartbeat");
    if (ends) return NULL;
    ends = require(dds_waitset_wait(session->ending, NULL, 0, kHeartbeat), "wait") > 0;
  }
}

Session* session_open(uint32_t domain, const char* name, const char* id) {
  Session* session = calloc(1, sizeof *session);
  if (!session) fail("out of memory");
  snprintf(session->name, sizeof session->name, "%s", name);
  snprintf(session->id, sizeof session->id, "%s", id);
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  session->incarnation = (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;  // another one at each start
  // The services of a run use no multicast: each asks the discovery ports of the hosts it knows. CYCLONEDDS_URI may say
  // otherwise, for other hosts.
  const char* loopback =
      "<General><Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\"/></Interfaces>"
      "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
      "<MaxAutoParticipantIndex>47</MaxAutoParticipantIndex><Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";
  if (!getenv("CYCLONEDDS_URI")) session->domain = require(dds_create_domain(domain, loopback), "enter the domain");
  session->participant = require(dds_create_participant(domain, NULL, NULL), "join the domain");
  session->waitset = require(dds_create_waitset(session->participant), "create a waitset");
  session->infos = endpoint(session, &citylearn_msg_TraversalInfo_desc, "citylearn/traversal_info", false, 1024);
  session->episodes = endpoint(session, &citylearn_msg_EpisodeStat_desc, "citylearn/episode_stat", false, 4096);
  char own[512], session_name[130], own_id[130];
  snprintf(own, sizeof own, "citylearn/%s/%s/service_status", escaped(name, session_name), escaped(id, own_id));
  session->heartbeats[0] = endpoint(session, &citylearn_msg_ServiceStatus_desc, own, true, 1);
  session->heartbeats[1] = endpoint(session, &citylearn_msg_ServiceStatus_desc, "citylearn/service_status", true, 1);
  session->end = require(dds_create_guardcondition(session->participant), "create a condition");
  session->ending = require(dds_create_waitset(session->participant), "create a waitset");
  require(dds_waitset_attach(session->ending, session->end, session->end), "wait for the end");
  if (pthread_create(&session->heart, NULL, send_heartbeats, session) != 0) fail("cannot start a thread");
  return session;
}

// What one env_service sends and is sent alone has topics of its own: citylearn/SESSION/ID/observation.
static dds_entity_t own_endpoint(Session* session, const EnvService* env, const dds_topic_descriptor_t* type,
                                 const char* name, bool writer, int32_t depth) {
  char topic[512], session_name[130], id[130];
  snprintf(topic, sizeof topic, "citylearn/%s/%s/%s", escaped(session->name, session_name), escaped(env->id, id), name);
  return endpoint(session, type, topic, writer, depth);
}

static void meet(Session* session, EnvService* env) {
  env->observations = own_endpoint(session, env, &citylearn_msg_Observation_desc, "observation", false, 1024);
  env->task_settings = own_endpoint(session, env, &citylearn_msg_TaskSettings_desc, "task_settings", true, 64);
  env->actions = own_endpoint(session, env, &citylearn_msg_Action_desc, "action", true, 1);
  env->acknowledgements =
      own_endpoint(session, env, &citylearn_msg_LogAcknowledgement_desc, "episode_acknowledgement", true, 64);
}

static bool same(const citylearn_msg_SettingsId* a, const citylearn_msg_SettingsId* b) {
  return a->incarnation == b->incarnation && a->version == b->version;
}

static bool of_this_session(const Session* session, const citylearn_msg_Header* header) {
  return header->protocol == citylearn_msg_PROTOCOL && strcmp(header->session, session->name) == 0;
}

static EnvService* env_by_id(Session* session, const char* id) {
  for (int i = 0; i < session->count; ++i)
    if (strcmp(session->envs[i].id, id) == 0) return &session->envs[i];
  return NULL;
}

// Notes a message of a process. Returns whether it speaks for its id: the one that was heard first does, until it is
// silent. Incarnations are only compared for equality, as a clock may have been set back.
static bool hear(EnvService* env, uint64_t incarnation) {
  const int64_t now = dds_time();
  if (incarnation == 0) return false;
  if (incarnation != env->incarnation && env->incarnation != 0 && now - env->heard < kGone) {
    if (env->rival != incarnation) env->rival_since = now;
    env->rival = incarnation;
    if (now - env->rival_since < kHandover) return false;
  }
  env->incarnation = incarnation;
  env->rival = 0;
  env->heard = env->silent_since = now;
  return true;
}

// Returns the sender; NULL when it is of another session, or of another process than the one that speaks for its id.
static EnvService* sender(Session* session, const citylearn_msg_Header* header) {
  if (!of_this_session(session, header)) return NULL;
  EnvService* env = env_by_id(session, header->sender);
  return env && env->incarnation == header->incarnation && hear(env, header->incarnation) ? env : NULL;
}

// ---- What is sent ---------------------------------------------------------------------------------------------------

static void send_settings(Session* session, EnvService* env) {
  stamp(session, &env->settings.header, ++session->sent_settings);
  require(dds_write(env->task_settings, &env->settings), "send settings");
  env->next_settings = dds_time() + kSettingsResendInterval;
}

void session_command(Session* session, EnvService* env, citylearn_msg_TaskSettings settings, const Policy* policy) {
  memcpy(settings.environment, env->id, sizeof settings.environment);
  settings.settings.incarnation = session->incarnation;
  settings.settings.version = ++session->version;  // a new id: the env_service starts again
  env->settings = settings;
  env->policy = policy;
  env->in_force = false;
  env->next_step = 0;
  env->commanded = env->silent_since = dds_time();
  send_settings(session, env);
}

static void send_action(Session* session, EnvService* env) {
  stamp(session, &env->answer.header, ++session->sent_actions);
  require(dds_write(env->actions, &env->answer), "send an action");
}

static void send_acknowledgement(Session* session, EnvService* env, bool leaving) {
  citylearn_msg_LogAcknowledgement message;
  memset(&message, 0, sizeof message);
  stamp(session, &message.header, ++session->sent_acknowledgements);
  memcpy(message.writer, env->id, sizeof message.writer);
  message.writer_incarnation = env->incarnation;
  message.number = env->recorded;
  message.state = leaving ? citylearn_msg_LEAVES : citylearn_msg_READS;
  require(dds_write(env->acknowledgements, &message), "acknowledge");
  env->acknowledge = false;
  env->next_acknowledgement = dds_time() + DDS_SECS(1);
}

void session_close(Session* session) {
  require(dds_set_guardcondition(session->end, true), "end the heartbeats");
  pthread_join(session->heart, NULL);
  // The env_services need not keep episodes for this learner any more.
  for (int i = 0; i < session->count; ++i) send_acknowledgement(session, &session->envs[i], true);
  dds_delete(session->participant);
  if (session->domain > 0) dds_delete(session->domain);
  free(session);
}

// ---- What comes -----------------------------------------------------------------------------------------------------

// Notes whose settings an env_service obeys, by its newest announcement. One that gave this learner's up for another's
// gets them again, under a new id: it takes them when the other one is idle, ends or is silent.
static void note_settings(Session* session, EnvService* env, const citylearn_msg_SettingsId* id) {
  env->obeys_other = id->version != 0 && id->incarnation != session->incarnation;
  if (same(id, &env->settings.settings)) env->in_force = true;
  if (!env->in_force || !env->obeys_other || env->settings.task_mode == citylearn_msg_IDLE) return;
  fprintf(stderr, "foreign_learner: env_service '%s' was taken over by another policy_service\n", env->id);
  session_command(session, env, env->settings, env->policy);
}

static void on_info(Session* session, const citylearn_msg_TraversalInfo* info) {
  // Without features an encoder_service is at work: the announcement comes again, complete.
  if (!of_this_session(session, &info->header) || info->feature_dimension == 0) return;
  EnvService* env = env_by_id(session, info->header.sender);
  if (!env) {
    if (session->count == kMaxEnvServices) fail("more than %d env_services", kMaxEnvServices);
    env = &session->envs[session->count++];
    memcpy(env->id, info->header.sender, sizeof env->id);
    meet(session, env);
  }
  const uint64_t before = env->incarnation;
  if (!hear(env, info->header.incarnation)) return;
  const bool fresh = before != env->incarnation;
  if (!fresh && info->header.message < env->info) return;  // overtaken on the way
  env->info = info->header.message;
  if (fresh) {
    env->recorded = 0;
    env->acknowledge = true;  // from now on it keeps what this learner has not recorded
  }
  memcpy(env->traversal, info->traversal, sizeof env->traversal);
  env->frames = info->frames;
  env->dimension = info->feature_dimension;
  env->agents = info->agents;
  if (env->settings.settings.version == 0) return;
  if (fresh && env->settings.task_mode != citylearn_msg_IDLE)
    session_command(session, env, env->settings, env->policy);  // it has lost its settings: the same, under a new id
  else
    note_settings(session, env, &info->settings);
}

static void on_observation(Session* session, const citylearn_msg_Observation* seen) {
  EnvService* env = sender(session, &seen->header);
  if (!env || env->settings.settings.version == 0 || !same(&seen->settings, &env->settings.settings)) return;
  if (seen->feature_dimension != env->dimension || seen->frame._length != env->agents) return;
  env->in_force = true;
  if (seen->step + 1 == env->next_step) {  // the answer was lost, or is on its way
    send_action(session, env);
    return;
  }
  if (seen->step != env->next_step || !env->policy) return;  // old
  env->policy->decide(env->policy->self, env, seen, env->choice);
  citylearn_msg_Action* answer = &env->answer;
  memcpy(answer->environment, env->id, sizeof answer->environment);
  answer->environment_incarnation = env->incarnation;
  answer->settings = seen->settings;
  answer->step = seen->step;
  answer->choice._buffer = env->choice;
  answer->choice._length = answer->choice._maximum = env->agents;
  ++env->next_step;
  send_action(session, env);
}

static void on_episode(Session* session, const citylearn_msg_EpisodeStat* episode) {
  EnvService* env = sender(session, &episode->header);
  if (!env) return;
  if (episode->log.first > env->recorded + 1) env->recorded = episode->log.first - 1;  // those before never come
  env->acknowledge = true;
  if (episode->log.number != env->recorded + 1) return;  // known, or there is a gap: what is missing comes again
  ++env->recorded;
  if (env->policy && same(&episode->settings, &env->settings.settings))
    env->policy->finished(env->policy->self, env, episode);
}

// Calls `handle` for each sample of the reader.
#define TAKE_ALL(reader, Type, handle)                                             \
  do {                                                                             \
    void* samples[1] = {NULL};                                                     \
    dds_sample_info_t info;                                                        \
    while (require(dds_take(reader, samples, &info, 1, 1), "take a sample") > 0) { \
      const Type* sample = samples[0];                                             \
      if (info.valid_data) handle;                                                 \
      require(dds_return_loan(reader, samples, 1), "return a sample");             \
      samples[0] = NULL;                                                           \
    }                                                                              \
  } while (0)

void session_spin(Session* session) {
  dds_attach_t triggered[1];
  require(dds_waitset_wait(session->waitset, triggered, 1, DDS_MSECS(50)), "wait");
  TAKE_ALL(session->infos, citylearn_msg_TraversalInfo, on_info(session, sample));
  for (int i = 0; i < session->count; ++i)
    TAKE_ALL(session->envs[i].observations, citylearn_msg_Observation, on_observation(session, sample));
  TAKE_ALL(session->episodes, citylearn_msg_EpisodeStat, on_episode(session, sample));
  const int64_t now = dds_time();
  for (int i = 0; i < session->count; ++i) {
    EnvService* env = &session->envs[i];
    if (env->acknowledge || now >= env->next_acknowledgement) send_acknowledgement(session, env, false);
    if (env->settings.settings.version == 0) continue;
    if (!env->in_force) {
      if (now >= env->next_settings) send_settings(session, env);
      // An idle env_service, or one whose policy_service is gone, would have taken them by now.
      const bool waits = env->obeys_other && now > env->commanded + kHeartbeat;
      if (waits && !env->waiting)
        fprintf(stderr, "foreign_learner: env_service '%s' works for another policy_service: waiting\n", env->id);
      env->waiting = waits;
      if (now > (waits ? env->silent_since : env->commanded) + kRefused)
        fail("env_service '%s' does not take its settings: its log says why", env->id);
    } else if (env->settings.task_mode != citylearn_msg_IDLE && now > env->silent_since + kSilence) {
      fail("env_service '%s' on %s went silent", env->id, env->traversal);
    }
  }
}

EnvService* session_find(Session* session, const char* traversal, double seconds) {
  const int64_t deadline = dds_time() + (int64_t)(seconds * 1e9);
  while (true) {
    for (int i = 0; i < session->count; ++i)
      if (strcmp(session->envs[i].traversal, traversal) == 0) return &session->envs[i];
    if (dds_time() > deadline)
      fail("no env_service with features on '%s' in session '%s': same --domain and --session there?", traversal,
           session->name);
    session_spin(session);
  }
}
