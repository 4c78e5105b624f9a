// SPDX-License-Identifier: Apache-2.0
// A learner in C that shares nothing with policy_service but idl/. While it explores the training traversal it counts:
// what each place looks like, and where each action leads. With these two tables alone it then navigates other
// traversals: a Bayes filter tells where it is, and it takes the action that most likely leads towards the goal.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "session.h"

enum { kMaxRestart = 0, kHere = 1, kAhead = 2, kMoves = 3 };  // where an action may lead

typedef struct Agent {
  int place, action;  // at the observation before; the action kept up while exploring
  double* belief;     // over the places
} Agent;

typedef struct Learner {
  int places, dimension, first_frame;
  float sharpness;                 // of the filter, see estimate()
  double* appearance;              // places x dimension: sums of what was seen
  double* visits;                  // places
  double moves[kActions][kMoves];  // counts
  double chance[kActions][kMoves];
  Agent* agent;
  double* scratch;                 // places
  uint64_t ticks, enough, random;  // observations learned from, and how many are wanted
  // The current evaluation, by task.
  uint32_t tasks, finished;
  bool* known;
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

// Place on the route of a frame on the traversal.
static int place_of(const Learner* self, uint32_t frame) {
  if (frame < (uint32_t)self->first_frame || frame - (uint32_t)self->first_frame >= (uint32_t)self->places)
    fail("frame %u is not on the route", frame);
  return (int)(frame - (uint32_t)self->first_frame);
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
    Agent* agent = &self->agent[i];
    const int place = place_of(self, seen->position._buffer[i]);
    const float* features = seen->features._buffer + (size_t)i * seen->feature_dimension;
    self->visits[place] += 1;
    for (int k = 0; k < self->dimension; ++k) self->appearance[place * self->dimension + k] += features[k];
    const int before = seen->previous_action._buffer[i];
    const int move = place - agent->place;
    if (before < kActions && abs(move) <= 1) self->moves[before][move + 1] += 1;
    agent->place = place;
    // Repeats an action for a while: independent random steps would hardly leave the place.
    if (draw(self, 24) == 0) agent->action = (int)draw(self, kActions);
    while (!allowed(seen, i, agent->action)) agent->action = (int)draw(self, kActions);
    choice[i] = (uint8_t)agent->action;
  }
  ++self->ticks;
}

static void ignore_episode(void* context, const EnvService* env, const citylearn_msg_EpisodeStat* episode) {
  (void)context, (void)env, (void)episode;
}

// Turns counts into means and probabilities.
static void estimate(Learner* self) {
  for (int place = 0; place < self->places; ++place) {
    if (self->visits[place] == 0) fail("frame %d was never seen: explore for more --ticks", place + self->first_frame);
    for (int k = 0; k < self->dimension; ++k) self->appearance[place * self->dimension + k] /= self->visits[place];
  }
  for (int action = 0; action < kActions; ++action) {
    double all = 0;
    for (int move = 0; move < kMoves; ++move) all += self->moves[action][move] + 0.01;
    for (int move = 0; move < kMoves; ++move) self->chance[action][move] = (self->moves[action][move] + 0.01) / all;
  }
  // How much a place may change from one traversal to another cannot be seen on one of them: a quarter of what tells
  // two places apart.
  double square = 0;
  for (int place = 0; place + 1 < self->places; ++place)
    for (int other = place + 1; other < self->places; ++other)
      for (int k = 0; k < self->dimension; ++k) {
        const double d = self->appearance[place * self->dimension + k] - self->appearance[other * self->dimension + k];
        square += d * d;
      }
  square /= self->places * (self->places - 1) / 2.0;
  self->sharpness = (float)(1 / (2 * square / 16));
}

// ---- Acting ---------------------------------------------------------------------------------------------------------

// Belief after `action`, before anything is seen.
static void predict(const Learner* self, double* belief, int action) {
  memset(self->scratch, 0, (size_t)self->places * sizeof *self->scratch);
  for (int place = 0; place < self->places; ++place)
    for (int move = 0; move < kMoves; ++move) {
      const int to = place + move - 1;
      if (to >= 0 && to < self->places) self->scratch[to] += belief[place] * self->chance[action][move];
    }
  memcpy(belief, self->scratch, (size_t)self->places * sizeof *belief);
}

static void correct(const Learner* self, double* belief, const float* features, int goal) {
  double nearest = INFINITY, sum = 0;
  for (int place = 0; place < self->places; ++place) {
    double square = 0;
    for (int k = 0; k < self->dimension; ++k) {
      const double d = features[k] - self->appearance[place * self->dimension + k];
      square += d * d;
    }
    self->scratch[place] = square;
    if (square < nearest) nearest = square;
  }
  for (int place = 0; place < self->places; ++place) {
    belief[place] = (belief[place] + 1e-9) * exp(-(self->scratch[place] - nearest) * self->sharpness);
    if (place == goal) belief[place] = 0;  // the episode would have ended there
    sum += belief[place];
  }
  for (int place = 0; place < self->places; ++place) belief[place] = sum > 0 ? belief[place] / sum : 1.0 / self->places;
}

static void navigate(void* context, const EnvService* env, const citylearn_msg_Observation* seen, uint8_t* choice) {
  Learner* self = context;
  for (uint32_t i = 0; i < env->agents; ++i) {
    choice[i] = kStay;
    if (seen->flags._buffer[i] & citylearn_msg_FLAG_IDLE) continue;
    double* belief = self->agent[i].belief;
    const int goal = place_of(self, seen->goal._buffer[i]);
    if (seen->flags._buffer[i] & citylearn_msg_FLAG_FIRST)
      for (int place = 0; place < self->places; ++place) belief[place] = 1.0 / self->places;
    else
      predict(self, belief, seen->previous_action._buffer[i]);
    correct(self, belief, seen->features._buffer + (size_t)i * seen->feature_dimension, goal);
    double before = 0;
    for (int place = 0; place < goal; ++place) before += belief[place];
    const int wanted = before > 0.5 ? kAhead : kMaxRestart;
    double best = -1;
    for (int action = 0; action < kActions; ++action) {
      if (!allowed(seen, i, action)) continue;
      // At an end of the route the wanted way may be closed: then away from the end rather than nothing.
      const double gain = self->chance[action][wanted] + 0.1 * self->chance[action][kMoves - 1 - wanted];
      if (gain > best) best = gain, choice[i] = (uint8_t)action;
    }
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
  long domain = 0, frames = 128, first = 0, max_steps = 128, ticks = 1500, tasks = 300, seed = 1, wait = 60;
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
    else if (strcmp(option, "--first-frame") == 0)
      first = number(option, value, 0, citylearn_msg_MAX_FRAMES);
    else if (strcmp(option, "--frames") == 0)
      frames = number(option, value, 2, citylearn_msg_MAX_FRAMES);
    else if (strcmp(option, "--max-steps") == 0)
      max_steps = number(option, value, 1, 1000000);
    else if (strcmp(option, "--ticks") == 0)
      ticks = number(option, value, 1, 1000000000);
    else if (strcmp(option, "--tasks") == 0)
      tasks = number(option, value, 1, 1000000);
    else if (strcmp(option, "--seed") == 0)
      seed = number(option, value, 1, 1000000000);
    else if (strcmp(option, "--wait") == 0)
      wait = number(option, value, 1, 100000);
    else
      fail(
          "unknown option %s (--domain --session --train --evaluate --first-frame --frames --max-steps --ticks --tasks "
          "--seed --wait)",
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

  Learner self = {.places = (int)frames, .dimension = (int)training_env->dimension, .first_frame = (int)first};
  self.enough = (uint64_t)ticks;
  self.random = (uint64_t)seed * 0x9E3779B97F4A7C15ull;
  self.appearance = zeroed((size_t)frames * training_env->dimension, sizeof *self.appearance);
  self.visits = zeroed((size_t)frames, sizeof *self.visits);
  self.scratch = zeroed((size_t)frames, sizeof *self.scratch);
  self.agent = zeroed(citylearn_msg_MAX_AGENTS, sizeof *self.agent);
  for (int i = 0; i < citylearn_msg_MAX_AGENTS; ++i)
    self.agent[i].belief = zeroed((size_t)frames, sizeof *self.agent[i].belief);

  citylearn_msg_TaskSettings settings;
  memset(&settings, 0, sizeof settings);
  settings.task_mode = citylearn_msg_TRAIN;
  settings.first_frame = (uint32_t)first;
  settings.frames = (uint32_t)frames;
  settings.max_steps = (uint32_t)max_steps;
  settings.seed = (uint64_t)seed;
  strcpy(settings.policy, "counting");
  const Policy explorer = {&self, explore, ignore_episode};
  session_command(session, training_env, settings, &explorer);
  while (self.ticks < self.enough) session_spin(session);
  command_idle(session, training_env);
  estimate(&self);
  printf("%s: %lu observations of %u agents; next leads ahead in %.1f %%, previous back in %.1f %% of the cases\n",
         train, (unsigned long)self.ticks, training_env->agents, 100 * self.chance[kNext][kAhead],
         100 * self.chance[kPrevious][kMaxRestart]);

  settings.task_mode = citylearn_msg_EVALUATE;
  settings.tasks = (uint32_t)tasks;
  for (int i = 0; i < evaluated; ++i)
    for (int shuffle = 0; shuffle < 2; ++shuffle) {
      settings.shuffle = shuffle == 1;
      evaluate(session, &self, envs[i], settings);
    }

  session_close(session);
  for (int i = 0; i < citylearn_msg_MAX_AGENTS; ++i) free(self.agent[i].belief);
  free(self.agent);
  free(self.scratch);
  free(self.visits);
  free(self.appearance);
  return 0;
}
