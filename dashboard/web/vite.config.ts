// SPDX-License-Identifier: Apache-2.0
import { readdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { gzipSync } from 'node:zlib';
import { defineConfig, type Plugin } from 'vite';

/** Writes NAME.gz beside what the server may send compressed. */
function compressed(): Plugin {
  return {
    name: 'compressed',
    apply: 'build',
    writeBundle: ({ dir: folder = '' }) => {
      for (const name of readdirSync(folder, { recursive: true, encoding: 'utf8' }))
        if (/\.(js|css|html|svg)$/.test(name)) writeFileSync(join(folder, `${name}.gz`), gzipSync(readFileSync(join(folder, name)), { level: 9 }));
    },
  };
}

// The server's Content-Security-Policy forbids inline scripts, styles and data: fonts, so nothing may be inlined.
export default defineConfig({
  base: './',
  plugins: [compressed()],
  build: {
    outDir: process.env.CITYLEARN_PAGE ?? 'dist',
    emptyOutDir: true,
    target: 'es2022',
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
  },
  server: {
    fs: { allow: ['.', '../../core/task'] }, // training_figures.inc
    proxy: { '^/(api|healthz|login)': { target: 'http://127.0.0.1:8080', ws: true } },
  },
});
