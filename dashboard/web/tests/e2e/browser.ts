// SPDX-License-Identifier: Apache-2.0
import type { TestProject } from 'vitest/node';
import { chromium } from 'playwright-core';
import { ARGS, executable } from '../chromium';

declare module 'vitest' {
  interface ProvidedContext {
    browser: string;
  }
}

/** One chromium for all specs; each opens contexts of its own in it. */
export default async function setup(project: TestProject): Promise<() => Promise<void>> {
  const server = await chromium.launchServer({ executablePath: executable(), args: ARGS });
  project.provide('browser', server.wsEndpoint());
  return () => server.close();
}
