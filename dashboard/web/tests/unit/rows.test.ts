// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from 'node:fs';
import { expect, it } from 'vitest';

const at = (path: string): string => readFileSync(`../../${path}`, 'utf8');

it('the reference page names the members of each row of the API, and no other ones', () => {
  const objects: string[] = [];
  let page = at('docs/reference/dashboard-api.md').replace(/: "[^"]*"(\s*\|\s*"[^"]*")*/g, '');
  // The innermost ones first.
  for (let before = ''; before !== page; ) {
    before = page;
    page = page.replace(/\{([^{}]*)\}/g, (_, members: string) => {
      objects.push([...members.matchAll(/"(\w+)"/g)].map(([, name]) => name).sort().join());
      return '';
    });
  }
  const rows = JSON.parse(at('dashboard/api/rows.json')) as Record<string, object>;
  for (const [row, members] of Object.entries(rows)) expect(objects, row).toContain(Object.keys(members).sort().join());
});
