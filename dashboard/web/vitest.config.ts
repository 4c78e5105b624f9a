// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from 'vitest/config';

export default defineConfig({
  server: { fs: { allow: ['.', '../../core/task'] } }, // training_figures.inc
  test: { include: ['tests/unit/**/*.test.ts'] },
});
