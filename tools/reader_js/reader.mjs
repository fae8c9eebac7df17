/**
 * Reading a block file by ranges: blocks by level or place, columns when they are asked for.
 *
 *     const file = await openBlockFile('https://example.org/bunny.gsb');
 *     for await (const block of file.blocks(file.head.levels - 1)) {
 *       draw(await block.words(), await block.normals());
 *     }
 *
 * Only the bytes asked for are read, and every byte is checked before it is trusted.
 * Spec: spec/blockfile.md.
 */

import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { LIMIT, fromMorton, toMorton } from './bytes.mjs';
import { checkNumbers, checkRecord, decodeColumn } from './columns.mjs';
import { crc32 } from './crc.mjs';
import { DATA, Directory } from './directory.mjs';
import { MAX_HEAD_BYTES, cut, parseHead } from './head.mjs';
import { directions } from './normals.mjs';
import { placesOf } from './octree.mjs';
import { sourceOf } from './source.mjs';

export { CorruptFileError, UnsupportedError } from './errors.mjs';

const MAX_GAP = 65536; // ranges closer than this are one request
const MAX_RUN = 2 ** 24; // but no request grows above this by joining

/**
 * Open a block file with one request.
 * @param {string | URL | Uint8Array | import('./source.mjs').Source} from a URL, a path (in Node),
 *   the file's bytes, or anything with a `read`
 * @returns {Promise<BlockFile>}
 */
export async function openBlockFile(from) {
  const source = await sourceOf(from);
  try {
    const start = await source.read(0, MAX_HEAD_BYTES);
    const head = parseHead(start);
    if (source.size !== undefined && source.size !== head.fileBytes) {
      throw cut(source.size, `the file has ${source.size} bytes, not ${head.fileBytes}`);
    }
    if (head.fileBytes >= LIMIT) throw new UnsupportedError('the file is longer than 2^53 bytes');
    return new BlockFile(source, head, start.subarray(head.headBytes));
  } catch (error) {
    await source.close();
    throw error;
  }
}

/** An open block file. */
export class BlockFile {
  #opening; // what is known of the bytes behind the head

  constructor(source, head, opening) {
    /** @type {import('./source.mjs').Source} */
    this.source = source;
    /** @type {import('./head.mjs').Head} */
    this.head = head;
    this.#opening = opening;
    this.directory = new Directory(head, (offset, length) => this.read(offset, length));
  }

  async close() {
    await this.source.close();
  }

  /**
   * Exactly so many bytes, from memory or with one request.
   * @param {number} offset
   * @param {number} length
   * @returns {Promise<Uint8Array>}
   */
  async read(offset, length) {
    const inside = offset - this.head.headBytes;
    if (inside >= 0 && inside + length <= this.#opening.length) {
      return this.#opening.subarray(inside, inside + length);
    }
    const data = length ? await this.source.read(offset, length) : new Uint8Array(0);
    if (data.length !== length) throw cut(offset, `wanted ${length} bytes, got ${data.length}`);
    return data;
  }

  /** Read the run of the coarsest levels, with one request or none; later reads use it. */
  async loadOpening() {
    const there = this.#opening;
    const { headBytes, openingBytes } = this.head;
    if (there.length >= openingBytes) return;
    const rest = await this.read(headBytes + there.length, openingBytes - there.length);
    this.#opening = new Uint8Array(openingBytes);
    this.#opening.set(there);
    this.#opening.set(rest, there.length);
  }

  /**
   * The blocks of a level, without the empty ones, in Morton order.
   * @param {number} level
   * @returns {AsyncGenerator<Block>}
   */
  async *blocks(level) {
    for await (const entry of this.directory.entries(level)) {
      if (entry.state === DATA) yield new Block(this, entry);
    }
  }

  /**
   * The block at block coordinates of a level; undefined where no voxel is.
   * @param {number} level
   * @param {number} x
   * @param {number} y
   * @param {number} z
   * @returns {Promise<Block | undefined>}
   */
  async block(level, x, y, z) {
    if ([x, y, z].some((place) => !(place >= 0 && place < 65536))) return undefined;
    const entry = await this.directory.find(level, toMorton(x, y, z));
    return entry?.state === DATA ? new Block(this, entry) : undefined;
  }

  /**
   * Which column it is, counted in the column table; a column that is absent is not invented.
   * @param {string} name
   */
  columnIndex(name) {
    const index = this.head.columns.findIndex((column) => column.name === name);
    if (index < 0) throw new UnsupportedError(`the file stores no column ${name}`);
    return index;
  }
}

/** One block of an open file. */
export class Block {
  /** @param {BlockFile} file */
  constructor(file, entry) {
    this.file = file;
    /** @type {import('./directory.mjs').Entry} */
    this.entry = entry;
    /** @type {Map<string, Uint8Array>} stored bytes that were fetched and not yet decoded */
    this.fetched = new Map();
  }

  get level() {
    return this.entry.level;
  }

  /** Number of voxels. */
  get count() {
    return this.entry.count;
  }

  /** Voxel coordinates, within the level, of the block's low corner. */
  get corner() {
    return fromMorton(this.entry.key).map((place) => place * 2 ** this.file.head.blockLog2);
  }

  /**
   * The stored bytes of a column, their CRC checked.
   * @param {string} name
   */
  async stored(name) {
    if (!this.fetched.has(name)) await loadColumns([this], [name]);
    return this.fetched.get(name);
  }

  /**
   * A decoded column, the components of a voxel side by side; of occupancy, local Morton codes.
   * @param {string} name
   * @returns {Promise<Uint8Array | Uint16Array | Uint32Array>}
   */
  async column(name) {
    const { head } = this.file;
    const index = this.file.columnIndex(name);
    const record = this.entry.records[index];
    checkRecord(head.columns[index], record, this.count, head.blockLog2);
    const stored = await this.stored(name);
    this.fetched.delete(name);
    return decodeColumn(head.columns[index], record, stored, this.count, head.blockLog2);
  }

  /**
   * The source triangles in the block, cut at its borders; none above level 0.
   * @returns {Promise<{vertices: Uint32Array, triangles: Uint32Array}>} vertices: x, y, z of each, snap
   *   units from the block's low corner; triangles: three numbers of vertices each
   */
  async pieces() {
    await loadColumns([this], ['vertex', 'triangle']);
    const vertices = await this.column('vertex');
    const triangles = await this.column('triangle');
    checkNumbers(triangles, vertices.length / 3);
    return { vertices, triangles };
  }

  /** x, y, z of each voxel within its level. */
  async positions() {
    return this.placed(await this.column('occupancy'));
  }

  /**
   * x, y, z within the level of local Morton codes.
   * @param {Uint32Array} codes
   */
  placed(codes) {
    const places = placesOf(codes);
    const [x, y, z] = this.corner;
    const positions = new Uint32Array(3 * places.length);
    for (let i = 0, to = 0; i < places.length; i++, to += 3) {
      positions[to] = x + (places[i] & 255);
      positions[to + 1] = y + ((places[i] >> 8) & 255);
      positions[to + 2] = z + (places[i] >> 16);
    }
    return positions;
  }

  /** One number per voxel for a GPU: x | y << 8 | z << 16 in the block, face mask in bits 24 to 29. */
  async words() {
    await loadColumns([this], ['occupancy', 'mask']);
    const words = placesOf(await this.column('occupancy'));
    const mask = await this.column('mask');
    for (let i = 0; i < words.length; i++) words[i] |= mask[i] << 24;
    return words;
  }

  /** Unit vectors x, y, z of each voxel in grid axes; 0, 0, 0 where it has no direction. */
  async normals() {
    return directions(await this.column('normal'), this.file.head.normalBits);
  }
}

/**
 * Fetch columns of blocks of one file; ranges that lie close together take one request, as a column of
 * eight siblings does.
 * @param {Block[]} blocks
 * @param {string[]} names
 */
export async function loadColumns(blocks, names) {
  const wanted = [];
  for (const block of blocks) {
    for (const name of names) {
      const { offset, stored, crc } = block.entry.records[block.file.columnIndex(name)];
      if (block.fetched.has(name)) continue;
      if (stored) wanted.push({ block, name, offset, end: offset + stored, crc });
      else block.fetched.set(name, new Uint8Array(0));
    }
  }
  wanted.sort((a, b) => a.offset - b.offset);
  for (let i = 0; i < wanted.length; ) {
    const { offset: begin, block } = wanted[i];
    let { end } = wanted[i];
    let next = i + 1;
    for (; next < wanted.length; next++) {
      const one = wanted[next];
      if (one.offset > end + MAX_GAP || one.end > Math.max(end, begin + MAX_RUN)) break;
      end = Math.max(end, one.end);
    }
    const data = await block.file.read(begin, end - begin);
    for (; i < next; i++) {
      const { block: to, name, offset, end: stop, crc } = wanted[i];
      const bytes = data.subarray(offset - begin, stop - begin);
      if (crc32(bytes) !== crc) {
        const said = `column ${name} of block ${to.entry.key}, level ${to.level}`;
        throw new CorruptFileError('GSB-0411', offset, `${said}, does not match its CRC`);
      }
      to.fetched.set(name, bytes);
    }
  }
}
