/**
 * How many ranges are asked for, and what becomes of a server that does not play along.
 *
 * The spec's vectors fit into the first request. GSB_DEPTH_1 and GSB_DEPTH_2 name files of many pages
 * with a page table of that depth; tests/conformance/test_reader_js.py makes them.
 */

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

import { UnsupportedError, loadColumns, openBlockFile } from '../reader.mjs';
import { serve, vector } from './vectors.mjs';

for (const depth of [1, 2]) {
  const path = process.env[`GSB_DEPTH_${depth}`];
  const skip = path ? false : `GSB_DEPTH_${depth} names no file`;
  const scene = () => new Uint8Array(readFileSync(path));

  test(`depth ${depth}: the first picture takes two requests`, { skip }, async (context) => {
    const server = await serve(context, scene());
    const file = await openBlockFile(server.url);
    await file.loadOpening();
    for await (const block of file.blocks(file.head.levels - 1)) {
      assert.equal((await block.words()).length, block.count);
      assert.equal((await block.normals()).length, 3 * block.count);
    }
    assert.equal(file.head.depth, depth);
    assert.equal(server.requests.length, 2);
    assert.equal(server.requests[0], 'bytes=0-65535');
    assert.match(server.requests[1], /^bytes=65536-/);
  });

  test(`depth ${depth}: any block takes ${depth + 2} requests at most`, { skip }, async (context) => {
    const server = await serve(context, scene());
    const everything = await openBlockFile(scene());
    const places = [];
    for await (const { entry, corner } of everything.blocks(0)) {
      if (entry.key % 97 === 0) places.push(corner.map((at) => at / 8));
    }
    assert.ok(places.length > 5);
    for (const place of places) {
      server.requests.length = 0;
      const file = await openBlockFile(server.url);
      const block = await file.block(0, ...place);
      assert.ok(server.requests.length <= depth + 1);
      await loadColumns([block], file.head.columns.map(({ name }) => name));
      for (const { name } of file.head.columns) await block.column(name);
      assert.ok(server.requests.length <= depth + 2, `${server.requests}`);
    }
  });

  test(`depth ${depth}: no request reaches beyond the file`, { skip }, async (context) => {
    const server = await serve(context, scene());
    const file = await openBlockFile(server.url);
    await file.loadOpening();
    for await (const block of file.blocks(1)) await block.column('occupancy');
    for (const range of server.requests) {
      assert.ok(Number(range.split('-')[1]) < server.data.length);
    }
  });
}

test('a column of siblings takes one request', { skip: !process.env.GSB_DEPTH_1 }, async (context) => {
  const server = await serve(context, new Uint8Array(readFileSync(process.env.GSB_DEPTH_1)));
  const file = await openBlockFile(server.url);
  const siblings = [];
  for await (const block of file.blocks(0)) {
    if (siblings.length && block.entry.key >> 3 !== siblings[0].entry.key >> 3) break;
    siblings.push(block);
  }
  assert.ok(siblings.length > 1);
  server.requests.length = 0;
  await loadColumns(siblings, ['normal']);
  assert.equal(server.requests.length, 1);
});

const SMALLEST = vector('good', 'blocks-smallest.gsb');

test('a small file takes one request', async (context) => {
  const server = await serve(context, SMALLEST);
  const file = await openBlockFile(server.url);
  for await (const block of file.blocks(0)) assert.deepEqual([...(await block.positions())], [1, 2, 3]);
  assert.equal(server.requests.length, 1);
});

test('a server that ignores ranges is refused, not swallowed', async (context) => {
  const server = await serve(context, SMALLEST, { ranges: false });
  await assert.rejects(openBlockFile(server.url), UnsupportedError);
});

test('a server that sends more than was asked for is refused', async (context) => {
  const server = await serve(context, new Uint8Array(70000), { extra: 100 });
  await assert.rejects(openBlockFile(server.url), /more than was asked for/);
});

test('a file that changed behind its URL is noticed', { skip: !process.env.GSB_DEPTH_1 }, async (context) => {
  const server = await serve(context, new Uint8Array(readFileSync(process.env.GSB_DEPTH_1)));
  const file = await openBlockFile(server.url);
  server.tag = '"2"';
  await assert.rejects(file.loadOpening(), /changed/);
});

test('no header but the range needs a server that allows it', { skip: !process.env.GSB_DEPTH_1 }, async (context) => {
  const server = await serve(context, new Uint8Array(readFileSync(process.env.GSB_DEPTH_1)));
  await (await openBlockFile(server.url)).loadOpening();
  assert.equal(server.headers.length, 2);
  for (const headers of server.headers) {
    assert.deepEqual(Object.keys(headers).filter((name) => name.startsWith('if-')), []);
  }
});

test('a file that is shorter than its head says is cut', async (context) => {
  const server = await serve(context, SMALLEST.subarray(0, -1));
  await assert.rejects(openBlockFile(server.url), { name: 'CorruptFileError', rule: 'GSB-0102' });
});

test('any object with a read is a source', async () => {
  const read = async (offset, length) => SMALLEST.subarray(offset, offset + length);
  const file = await openBlockFile({ name: 'mine', size: undefined, read, close: async () => {} });
  assert.equal(file.head.resolution, 8);
});
