/**
 * `node conformance.mjs`: reads paths on standard input, one a line, and answers each with one line of
 * JSON: whether a reader accepts the file, the rule that it found broken, and what the file holds.
 * spec/conformance/README.md has the protocol.
 */

import { open } from 'node:fs/promises';
import { createInterface } from 'node:readline';

import { Blake2b } from './blake2b.mjs';
import { CorruptFileError, UnsupportedError, openBlockFile } from './reader.mjs';
import { openStream } from './stream.mjs';
import { readWhole } from './whole.mjs';

const DIGEST_BYTES = 16;

/** Counts, and digests of decoded values by column, of one level; or of all chunks of a stream. */
class Summary {
  #digests = new Map();

  constructor(level) {
    this.level = level;
  }

  count(counts) {
    for (const [name, count] of Object.entries(counts)) this[name] = (this[name] ?? 0) + count;
  }

  /** Add values to a column; null makes it one that cannot be read. */
  add(name, values) {
    if (!this.#digests.has(name)) this.#digests.set(name, new Blake2b(DIGEST_BYTES));
    if (values === null) this.#digests.set(name, null);
    if (values) {
      const { buffer, byteOffset, byteLength } = values;
      this.#digests.get(name)?.update(new Uint8Array(buffer, byteOffset, byteLength));
    }
  }

  toJSON() {
    const columns = [...this.#digests].map(([name, digest]) => [name, digest?.hex() ?? null]);
    return { ...this, columns: Object.fromEntries(columns) };
  }
}

async function blockFileContent(path) {
  const file = await openBlockFile(path);
  try {
    const levels = new Map();
    await readWhole(file, ({ level, entry, count }, name, values) => {
      if (!levels.has(level)) levels.set(level, new Summary(level));
      const summary = levels.get(level);
      if (name === 'occupancy') {
        summary.count({ blocks: 1, voxels: count });
        summary.add('key', new BigUint64Array([BigInt(entry.key)]));
      }
      summary.add(name, values);
    });
    return [...levels.values()].reverse();
  } finally {
    await file.close();
  }
}

async function streamContent(path) {
  const file = await openStream(path);
  try {
    const all = new Summary(0);
    for (let i = 0; i < file.rows.length; i++) {
      const { triangles, vertices, parts } = await file.chunk(i);
      all.count({ chunks: 1, triangles, vertices });
      for (const { attribute, values } of parts) all.add(attribute, values);
    }
    return file.rows.length ? [all] : [];
  } finally {
    await file.close();
  }
}

/** Whether a file is a geometry stream: by its magic, or by its name where the magic is damaged. */
async function isStream(path) {
  const handle = await open(path, 'r');
  const { buffer } = await handle.read(Buffer.alloc(4), 0, 4, 0);
  await handle.close();
  const word = buffer.toString('latin1', 1);
  return word === 'GST' || (word !== 'GSB' && path.endsWith('.gst'));
}

async function answer(path) {
  try {
    const content = (await isStream(path)) ? streamContent : blockFileContent;
    return { valid: true, codes: [], content: { levels: await content(path) } };
  } catch (error) {
    if (error instanceof CorruptFileError) return { valid: false, codes: [error.rule] };
    if (error instanceof UnsupportedError) return { valid: false, codes: ['unsupported'] };
    throw error;
  }
}

for await (const path of createInterface({ input: process.stdin })) {
  if (path) console.log(JSON.stringify(await answer(path)));
}
