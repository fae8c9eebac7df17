/** Source triangles of finest blocks: spec, section 7.4. */

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { CorruptFileError, UnsupportedError, openBlockFile } from '../reader.mjs';
import { vector } from './vectors.mjs';

const EDGE = 2 ** 15; // of a block of the vectors, in snap units

test('vertices and triangles of a block are those that the vector was made of', async () => {
  const file = await openBlockFile(vector('good', 'blocks-pieces.gsb'));
  const { vertices, triangles } = await (await file.block(0, 0, 0, 0)).pieces();
  assert.deepEqual([...vertices], [0, 0, 0, 27873, 20872, 16749, EDGE, EDGE, EDGE]);
  assert.deepEqual([...triangles], [0, 1, 2]);
});

test('blocks without triangles, and those above level 0, have none', async () => {
  const file = await openBlockFile(vector('good', 'blocks-pieces.gsb'));
  for (const block of [await file.block(0, 1, 0, 0), await file.block(1, 0, 0, 0)]) {
    const { vertices, triangles } = await block.pieces();
    assert.deepEqual([vertices.length, triangles.length], [0, 0]);
  }
});

test('every filter and codec gives the vertices of a strip', async () => {
  const file = await openBlockFile(vector('good', 'blocks-pieces-every-filter.gsb'));
  let blocks = 0;
  for await (const block of file.blocks(0)) {
    const { vertices, triangles } = await block.pieces();
    const numbers = Array.from({ length: triangles.length / 3 }, (_, i) => [i, i + 1, i + 2]);
    assert.deepEqual([...triangles], numbers.flat());
    assert.ok(vertices.every((coordinate) => coordinate <= EDGE));
    assert.equal(vertices.at(-1) ?? EDGE, EDGE);
    blocks += vertices.length > 0;
  }
  assert.equal(blocks, 10);
});

test('a number beyond the vertices is refused, and so are triangles that a file has not', async () => {
  const wrong = await openBlockFile(vector('bad', 'GSB-0413.gsb'));
  const block = await wrong.block(0, 0, 0, 0);
  await assert.rejects(block.pieces(), (error) => {
    return error instanceof CorruptFileError && error.rule === 'GSB-0413';
  });
  const plain = await openBlockFile(vector('good', 'blocks-all-columns.gsb'));
  await assert.rejects((await plain.block(0, 0, 0, 0)).pieces(), UnsupportedError);
});
