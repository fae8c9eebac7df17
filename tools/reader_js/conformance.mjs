/**
 * `node conformance.mjs`: reads paths on standard input, one a line, and answers each with one line of
 * JSON: whether a reader accepts the file, the rules that it found broken, and what the file holds.
 */

import { createInterface } from 'node:readline';

import { Blake2b } from './blake2b.mjs';
import { CorruptFileError, UnsupportedError, openBlockFile } from './reader.mjs';
import { readWhole } from './whole.mjs';

const DIGEST_BYTES = 16;

/** Per level: blocks, voxels, and the digest of each column's decoded values in file order. */
async function contentOf(file) {
  const { columns, levelTable } = file.head;
  const levels = levelTable.map((_, level) => ({
    level,
    blocks: 0,
    voxels: 0,
    columns: Object.fromEntries(columns.map(({ name }) => [name, new Blake2b(DIGEST_BYTES)])),
  }));
  const unknown = await readWhole(file, (block, name, values) => {
    const level = levels[block.level];
    if (name === 'occupancy') {
      level.blocks += 1;
      level.voxels += block.count;
    }
    const { buffer, byteOffset, byteLength } = values;
    level.columns[name].update(new Uint8Array(buffer, byteOffset, byteLength));
  });
  for (const level of levels) {
    for (const name of unknown) delete level.columns[name];
    for (const name in level.columns) level.columns[name] = level.columns[name].hex();
  }
  return { levels };
}

async function answer(path) {
  let file;
  try {
    file = await openBlockFile(path);
    return { valid: true, codes: [], content: await contentOf(file) };
  } catch (error) {
    if (error instanceof CorruptFileError) return { valid: false, codes: [error.rule] };
    if (error instanceof UnsupportedError) return { valid: false, codes: ['unsupported'] };
    throw error;
  } finally {
    await file?.close();
  }
}

for await (const path of createInterface({ input: process.stdin })) {
  if (path) console.log(JSON.stringify(await answer(path)));
}
