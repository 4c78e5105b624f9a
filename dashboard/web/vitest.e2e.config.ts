// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from 'vitest/config';

// One browser, two pages at a time: a page waits for the server as long as it draws.
export default defineConfig({
  server: { fs: { allow: ['.', '../../core/task'] } }, // training_figures.inc
  test: {
    include: ['tests/e2e/**/*.test.ts'],
    globalSetup: 'tests/e2e/city.ts',
    maxWorkers: 2,
    minWorkers: 1,
    retry: 1, // the report names what was tried again
    testTimeout: 120_000, // deadlines are for a busy machine with two processors
    hookTimeout: 120_000,
    expect: { poll: { interval: 50, timeout: 60_000 } },
  },
});
