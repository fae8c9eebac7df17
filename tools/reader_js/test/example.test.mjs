/** The page is not run here, for want of a browser; a name that it imports and nobody exports is found. */

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

const PAGE = readFileSync(new URL('../example.html', import.meta.url), 'utf8');

test('what the example page imports is there', async () => {
  const imports = [...PAGE.matchAll(/^import \{ (.+) \} from '\.\/(.+)';$/gm)];
  assert.ok(imports.length > 2);
  for (const [, names, module] of imports) {
    const exported = Object.keys(await import(`../${module}`));
    for (const name of names.split(', ')) assert.ok(exported.includes(name), `${name} of ${module}`);
  }
});
