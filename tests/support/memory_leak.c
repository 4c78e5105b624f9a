// SPDX-License-Identifier: Apache-2.0
// Preloaded into a service, this leaks memory from the moment when the process gets SIGUSR2: 200 MB/s, as fast as a
// fault of a library might.
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

static sem_t asked;

static void on_signal(int signal) {
  (void)signal;
  sem_post(&asked);
}

static void* leak(void* unused) {
  (void)unused;
  while (sem_wait(&asked) != 0) continue;  // another signal came
  const size_t size = 4 << 20;
  for (char* leaked; (leaked = malloc(size)); poll(NULL, 0, 20)) memset(leaked, 1, size);
  return NULL;
}

__attribute__((constructor)) static void begin(void) {
  const char* const name = program_invocation_short_name;
  if (!strstr(name, "_service") && strcmp(name, "dashboard") != 0) return;
  sem_init(&asked, 0, 0);
  signal(SIGUSR2, on_signal);
  pthread_t thread;
  pthread_create(&thread, NULL, leak, NULL);
}
