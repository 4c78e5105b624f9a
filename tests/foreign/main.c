// SPDX-License-Identifier: Apache-2.0
// A learner in C that shares nothing with policy_service but idl/. While it explores the training traversal it learns
// what each place looks like: the mean of what was seen there. On any traversal it then compares all that it has seen
// in an episode with that, to know where it is, and goes towards the goal.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "session.h"

typedef struct Learner {
  int places, dimension;
  double* looks;                        // places x dimension: sums of what was seen there, then means
  double* visits;                       // by place
  double* apart;                        // agents x places, see locate()
  int going[citylearn_msg_MAX_AGENTS];  // the action that an agent keeps up while it explores
  uint64_t ticks, enough, random;       // observations learned from, and how many are wanted
  uint32_t tasks, finished;             // of the current evaluation
  bool* known;                          // by task
  double completed, spl;
} Learner;

static void* zeroed(size_t count, size_t size) {
  void* memory = calloc(count, size);
  if (!memory) fail("out of memory");
  return memory;
}

static uint32_t draw(Learner* self, uint32_t bound) {  // xorshift64*
  self->random ^= self->random >> 12;
  self->random ^= self->random << 25;
  self->random ^= self->random >> 27;
  return (uint32_t)(self->random * 2685821657736338717ull >> 33) % bound;
}

static bool allowed(const citylearn_msg_Observation* seen, uint32_t agent, int action) {
  return seen->allowed._buffer[agent] >> action & 1;
}

// ---- Learning -------------------------------------------------------------------------------------------------------

static void explore(void* context, const EnvService* env, const citylearn_msg_Observation* seen, uint8_t* choice) {
  Learner* self = context;
  memset(choice, kStay, env->agents);
  if (self->ticks == self->enough) return;
  for (uint32_t i = 0; i < env->agents; ++i) {
    const uint32_t place = seen->position._buffer[i];
    if (place >= (uint32_t)self->places) fail("frame %u is not on the route", place);
    const float* features = seen->features._buffer + (size_t)i * seen->feature_dimension;
    self->visits[place] += 1;
    for (int k = 0; k < self->dimension; ++k)
      self->looks[place * (uint32_t)self->dimension + (uint32_t)k] += features[k];
    // Repeats an action for a while: independent random steps would hardly leave the place.
    if (draw(self, 24) == 0) self->going[i] = (int)draw(self, kActions);
    while (!allowed(seen, i, self->going[i])) self->going[i] = (int)draw(self, kActions);
    choice[i] = (uint8_t)self->going[i];
  }
  ++self->ticks;
}

static void ignore_episode(void* context, const EnvService* env, const citylearn_msg_EpisodeStat* episode) {
  (void)context, (void)env, (void)episode;
}

// Turns sums into means.
static void estimate(Learner* self) {
  for (int place = 0; place < self->places; ++place) {
    if (self->visits[place] == 0) fail("frame %d was never seen: explore for more --ticks", place);
    for (int k = 0; k < self->dimension; ++k) self->looks[place * self->dimension + k] /= self->visits[place];
  }
}

// ---- Acting ---------------------------------------------------------------------------------------------------------

// Returns the place from which the agent saw most nearly what it saw in this episode. `apart` has, by place, how far
// all that was from what is seen on the way there.
static int locate(const Learner* self, double* apart, bool first, int action, const float* features) {
  const size_t others = (size_t)self->places - 1;
  if (first) memset(apart, 0, (others + 1) * sizeof *apart);
  if (!first && action == kNext) memmove(apart + 1, apart, others * sizeof *apart), apart[0] = INFINITY;
  if (!first && action == kPrevious) memmove(apart, apart + 1, others * sizeof *apart), apart[others] = INFINITY;
  int found = 0;
  for (int place = 0; place < self->places; ++place) {
    for (int k = 0; k < self->dimension; ++k) {
      const double d = features[k] - self->looks[place * self->dimension + k];
      apart[place] += d * d;
    }
    if (apart[place] < apart[found]) found = place;
  }
  return found;
}

static void navigate(void* context, const EnvService* env, const citylearn_msg_Observation* seen, uint8_t* choice) {
  const Learner* self = context;
  for (uint32_t i = 0; i < env->agents; ++i) {
    choice[i] = kStay;
    const uint8_t flags = seen->flags._buffer[i];
    if (flags & citylearn_msg_FLAG_IDLE) continue;
    const int here = locate(self, self->apart + i * (size_t)self->places, flags & citylearn_msg_FLAG_FIRST,
                            seen->previous_action._buffer[i], seen->features._buffer + (size_t)i * env->dimension);
    const int wanted = (uint32_t)here < seen->goal._buffer[i] ? kNext : kPrevious;
    choice[i] = (uint8_t)(allowed(seen, i, wanted) ? wanted : kNext + kPrevious - wanted);
  }
}

static void record(void* context, const EnvService* env, const citylearn_msg_EpisodeStat* episode) {
  Learner* self = context;
  (void)env;
  if (!episode->evaluation || episode->task >= self->tasks || self->known[episode->task]) return;
  self->known[episode->task] = true;
  ++self->finished;
  if (!episode->completed) return;
  self->completed += 1;
  self->spl += (double)episode->shortest / (episode->steps > episode->shortest ? episode->steps : episode->shortest);
}

// Leaves the env_service idle for the next learner.
static void command_idle(Session* session, EnvService* env) {
  citylearn_msg_TaskSettings settings;
  memset(&settings, 0, sizeof settings);
  settings.task_mode = citylearn_msg_IDLE;
  session_command(session, env, settings, NULL);
  while (!env->in_force) session_spin(session);
}

static void evaluate(Session* session, Learner* self, EnvService* env, citylearn_msg_TaskSettings settings) {
  self->tasks = settings.tasks;
  self->finished = 0;
  self->completed = self->spl = 0;
  self->known = zeroed(self->tasks, sizeof *self->known);
  const Policy navigator = {self, navigate, record};
  session_command(session, env, settings, &navigator);
  while (self->finished < self->tasks) session_spin(session);
  command_idle(session, env);
  printf("%s%s: %u tasks, completed %.4f, SPL %.4f\n", env->traversal, settings.shuffle ? ", shuffled" : "",
         self->tasks, self->completed / self->tasks, self->spl / self->tasks);
  fflush(stdout);
  free(self->known);
}

// ---- The run --------------------------------------------------------------------------------------------------------

static long number(const char* option, const char* text, long lowest, long highest) {
  char* end;
  const long value = strtol(text, &end, 10);
  if (*text == '\0' || *end != '\0' || value < lowest || value > highest)
    fail("%s: '%s' is no number of %ld..%ld", option, text, lowest, highest);
  return value;
}

int main(int count, char** arguments) {
  const char *run = "default", *train = "summer", *others[16];
  long domain = 0, frames = 128, max_steps = 128, ticks = 1500, tasks = 300, wait = 60;
  int evaluated = 0;
  for (int i = 1; i < count; i += 2) {
    const char *option = arguments[i], *value = arguments[i + 1];
    if (i + 1 == count) fail("%s needs a value", option);
    if (strcmp(option, "--session") == 0)
      run = value;
    else if (strcmp(option, "--train") == 0)
      train = value;
    else if (strcmp(option, "--evaluate") == 0 && evaluated < 16)
      others[evaluated++] = value;  // once for each traversal
    else if (strcmp(option, "--domain") == 0)
      domain = number(option, value, 0, 232);
    else if (strcmp(option, "--frames") == 0)
      frames = number(option, value, 2, citylearn_msg_MAX_FRAMES);
    else if (strcmp(option, "--max-steps") == 0)
      max_steps = number(option, value, 1, 1000000);
    else if (strcmp(option, "--ticks") == 0)
      ticks = number(option, value, 1, 1000000000);
    else if (strcmp(option, "--tasks") == 0)
      tasks = number(option, value, 1, 1000000);
    else if (strcmp(option, "--wait") == 0)
      wait = number(option, value, 1, 100000);
    else
      fail("unknown option %s (--domain --session --train --evaluate --frames --max-steps --ticks --tasks --wait)",
           option);
  }
  if (evaluated == 0) others[evaluated++] = train;

  Session* session = session_open((uint32_t)domain, run, "foreign");
  EnvService* training_env = session_find(session, train, (double)wait);
  EnvService* envs[16];
  for (int i = 0; i < evaluated; ++i) {
    envs[i] = session_find(session, others[i], (double)wait);
    if (envs[i]->dimension != training_env->dimension)
      fail("%s has %u features, %s has %u", others[i], envs[i]->dimension, train, training_env->dimension);
  }

  Learner self = {.places = (int)frames, .dimension = (int)training_env->dimension, .random = 0x9E3779B97F4A7C15ull};
  self.enough = (uint64_t)ticks;
  self.looks = zeroed((size_t)frames * training_env->dimension, sizeof *self.looks);
  self.visits = zeroed((size_t)frames, sizeof *self.visits);
  self.apart = zeroed((size_t)frames * citylearn_msg_MAX_AGENTS, sizeof *self.apart);

  citylearn_msg_TaskSettings settings;
  memset(&settings, 0, sizeof settings);
  settings.task_mode = citylearn_msg_TRAIN;
  settings.frames = (uint32_t)frames;
  settings.max_steps = (uint32_t)max_steps;
  settings.seed = 1;
  strcpy(settings.policy, "nearest");
  const Policy explorer = {&self, explore, ignore_episode};
  session_command(session, training_env, settings, &explorer);
  while (self.ticks < self.enough) session_spin(session);
  command_idle(session, training_env);
  estimate(&self);
  printf("%s: learned from %lu observations of %u agents\n", train, (unsigned long)self.ticks, training_env->agents);

  settings.task_mode = citylearn_msg_EVALUATE;
  settings.tasks = (uint32_t)tasks;
  for (int i = 0; i < evaluated; ++i)
    for (int shuffle = 0; shuffle < 2; ++shuffle) {
      settings.shuffle = shuffle == 1;
      evaluate(session, &self, envs[i], settings);
    }

  session_close(session);
  free(self.apart);
  free(self.visits);
  free(self.looks);
  return 0;
}
