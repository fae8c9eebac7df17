/** Geometry streams: the vectors of the spec, every bit flip, every cut. */

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { CorruptFileError, UnsupportedError } from '../errors.mjs';
import { openStream } from '../stream.mjs';
import { serve, vector, vectors } from './vectors.mjs';

/** Rules that only a validator looks at: descriptors of parts, sums and box of the totals; a note. */
const NOT_OURS = /^GST-(0118|0119|0210|0213)/;

async function verdict(data) {
  try {
    const stream = await openStream(data);
    for (let i = 0; i < stream.rows.length; i++) await stream.chunk(i);
    return 'valid';
  } catch (error) {
    if (error instanceof CorruptFileError) return error.rule;
    if (error instanceof UnsupportedError) return 'unsupported';
    throw error;
  }
}

for (const name of vectors('good', 'gst')) {
  test(`${name} is read`, async () => {
    assert.equal(await verdict(vector('good', name)), 'valid');
  });
}

for (const name of vectors('bad', 'gst')) {
  const ours = !NOT_OURS.test(name);
  test(`${name} is ${ours ? 'refused for that rule' : 'read'}`, async () => {
    assert.equal(await verdict(vector('bad', name)), ours ? name.slice(0, 8) : 'valid');
  });
}

test('no bit of the smallest stream can flip unnoticed', async () => {
  const data = vector('good', 'stream-smallest.gst');
  for (let bit = 0; bit < 8 * data.length; bit++) {
    data[bit >> 3] ^= 1 << (bit & 7);
    assert.notEqual(await verdict(data), 'valid', `bit ${bit}`);
    data[bit >> 3] ^= 1 << (bit & 7);
  }
});

test('a stream cut anywhere is refused', async () => {
  const data = vector('good', 'stream-indexed.gst');
  for (let end = 0; end < data.length; end++) {
    assert.notEqual(await verdict(data.subarray(0, end)), 'valid', `${end} bytes`);
  }
});

test('a stream is read by ranges', async (context) => {
  const server = await serve(context, vector('good', 'stream-smallest.gst'));
  const stream = await openStream(server.url);
  const { parts } = await stream.chunk(0);
  assert.deepEqual([...parts[0].values], [0, 0, 0, 1, 0, 0, 0, 2, -0]);
  assert.equal(server.requests.length, 5); // header, tail, directory, head, payload
});
