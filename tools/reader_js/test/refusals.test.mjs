/** What a reader refuses: the bad vectors, every bit flip, every cut, and numbers too large. */

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { CorruptFileError, UnsupportedError, openBlockFile } from '../reader.mjs';
import { crc32 } from '../crc.mjs';
import { readWhole } from '../whole.mjs';
import { vector, vectors } from './vectors.mjs';

/** Rules for validators alone: levels recomputed, content id, ledger, source triangles; two notes. */
const NOT_OURS = /^GSB-(0412|0414|050[3-9]|060[1-4])/;

async function verdict(data) {
  try {
    await readWhole(await openBlockFile(data));
    return 'valid';
  } catch (error) {
    if (error instanceof CorruptFileError) return error.rule;
    if (error instanceof UnsupportedError) return 'unsupported';
    throw error;
  }
}

for (const name of vectors('good', 'gsb')) {
  test(`${name} is read`, async () => {
    assert.equal(await verdict(vector('good', name)), 'valid');
  });
}

for (const name of vectors('bad', 'gsb')) {
  const ours = !NOT_OURS.test(name);
  test(`${name} is ${ours ? 'refused for that rule' : 'read'}`, async () => {
    assert.equal(await verdict(vector('bad', name)), ours ? name.slice(0, 8) : 'valid');
  });
}

test('no bit of the smallest file can flip unnoticed', async () => {
  const data = vector('good', 'blocks-smallest.gsb');
  for (let bit = 0; bit < 8 * data.length; bit++) {
    data[bit >> 3] ^= 1 << (bit & 7);
    assert.notEqual(await verdict(data), 'valid', `bit ${bit}`);
    data[bit >> 3] ^= 1 << (bit & 7);
  }
});

test('a file cut anywhere is refused', async () => {
  const data = vector('good', 'blocks-all-columns.gsb');
  for (let end = 0; end < data.length; end += 7) {
    assert.notEqual(await verdict(data.subarray(0, end)), 'valid', `${end} bytes`);
  }
});

/** The smallest file with bytes changed, and the CRCs of page, head and tail made right again. */
function changed(at, bytes) {
  const data = vector('good', 'blocks-smallest.gsb');
  data.set(bytes, at);
  const view = new DataView(data.buffer);
  const head = view.getUint32(28, true);
  view.setUint32(0x1fc, crc32(data.subarray(head, head + 88)), true);
  view.setUint32(head - 4, crc32(data.subarray(0, head - 4)), true);
  const tail = data.length - 64;
  data.copyWithin(tail + 12, 32, 56);
  view.setUint32(tail + 36, crc32(data.subarray(0, head - 4)), true);
  view.setUint32(tail + 60, crc32(data.subarray(tail, tail + 60)), true);
  return data;
}

const MOST = [255, 255, 255, 255, 255, 255, 255, 255];
const ENTRY = 0x21d;

for (const [what, at, bytes, rule] of [
  ['2^64 bytes', 32, MOST, 'GSB-0102'],
  ['2^64 blocks', 216, MOST, 'GSB-0105'],
  ['2^32 pages', 232, MOST.slice(4), 'GSB-0105'],
  ['an opening run of 2^64 bytes', 224, MOST, 'GSB-0310'],
  ['a page 2^64 bytes behind the beginning', 0x1f0, MOST, 'GSB-0206'],
  ['a page of 2^32 rows', 0x1e4, MOST.slice(4), 'GSB-0206'],
  ['a section of 2^64 bytes', 0x110, MOST, 'GSB-0201'],
  ['a block with the key 2^64', ENTRY, MOST, 'GSB-0302'],
  ['a block of 2^32 voxels', ENTRY + 8, MOST.slice(4), 'GSB-0409'],
  ['a column of 2^32 raw bytes', ENTRY + 24 + 12, MOST.slice(4), 'GSB-0311'],
  ['a column of 2^32 stored bytes', ENTRY + 24 + 8, MOST.slice(4), 'GSB-0311'],
  ['a column 2^64 bytes behind the beginning', ENTRY + 24, MOST, 'GSB-0311'],
  ['a newer version', 12, [2], 'unsupported'],
  ['an incompatible feature', 16, [1], 'unsupported'],
]) {
  test(`a file that states ${what} is refused`, async () => {
    assert.equal(await verdict(changed(at, bytes)), rule);
  });
}

test('a column that the file does not have is not invented', async () => {
  const file = await openBlockFile(vector('good', 'blocks-smallest.gsb'));
  for await (const block of file.blocks(0)) {
    await assert.rejects(block.column('colour'), /stores no column colour/);
  }
});

test('a column of an unknown codec spoils no other column', async () => {
  const file = await openBlockFile(vector('bad', 'GSB-0412.gsb'));
  for await (const block of file.blocks(0)) {
    await assert.rejects(block.column('mask'), UnsupportedError);
    assert.equal((await block.column('weight')).length, block.count);
    break;
  }
});
