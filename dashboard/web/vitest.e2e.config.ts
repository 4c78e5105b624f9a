// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from 'vitest/config';

// One browser, one page at a time: a chromium takes more than a core while it draws.
export default defineConfig({
  server: { fs: { allow: ['.', '../../core/task'] } }, // training_figures.inc
  test: {
    include: ['tests/e2e/**/*.test.ts'],
    globalSetup: 'tests/e2e/city.ts',
    fileParallelism: false,
    testTimeout: 30_000,
    hookTimeout: 60_000,
  },
});
