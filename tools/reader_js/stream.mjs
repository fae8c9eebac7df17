/** A geometry stream: header, directory, chunks when they are asked for. Spec: spec/stream.md. */

import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { u64, viewOf, zeros } from './bytes.mjs';
import { crc32 } from './crc.mjs';
import { parseObject } from './json.mjs';
import { sourceOf } from './source.mjs';
import {
  ATTRIBUTES,
  MAX_HEAD_BYTES,
  checkTriangles,
  decodeParts,
  parseChunkHead,
} from './stream_chunk.mjs';

const MAGIC = [0x89, 0x47, 0x53, 0x54, 0x20, 0x31, 0x2e, 0x30, 0x0d, 0x0a, 0x1a, 0x0a];
const VERSION = 1;
const FIXED_BYTES = 36;
const ROW_BYTES = 72;
const TAIL_BYTES = 48;
const RESERVED = { 5: ['uv', 4, 2], 6: ['material', 2, 1], 7: ['object', 3, 1] };

/**
 * @typedef {object} Row
 * @property {number} offset
 * @property {number} length
 * @property {number} triangles
 * @property {number} vertices
 * @property {number} source
 * @property {number[]} box low x y z, high x y z
 */

/**
 * Open a geometry stream.
 * @param {string | URL | Uint8Array | import('./source.mjs').Source} from
 * @returns {Promise<GeometryStream>}
 */
export async function openStream(from) {
  const source = await sourceOf(from);
  try {
    const header = await readHeader(source);
    const directory = await readDirectory(source, header);
    return new GeometryStream(source, header, directory);
  } catch (error) {
    await source.close();
    throw error;
  }
}

/** An open geometry stream. */
export class GeometryStream {
  constructor(source, header, { rows, totals }) {
    this.source = source;
    /** @type {{id: number, dtype: number, components: number, name: string}[]} */
    this.attributes = header.attributes;
    this.metadata = header.metadata;
    /** @type {Row[]} */
    this.rows = rows;
    this.totals = totals;
  }

  async close() {
    await this.source.close();
  }

  /**
   * One chunk, unpacked and checked.
   * @param {number} number
   */
  async chunk(number) {
    const row = this.rows[number];
    const { offset, length } = row;
    const start = await this.source.read(offset, Math.min(length, MAX_HEAD_BYTES));
    const head = parseChunkHead(start, offset);
    const same =
      head.headBytes + head.payload === length &&
      ['triangles', 'vertices', 'source'].every((name) => head[name] === row[name]) &&
      head.box.every((value, i) => value === row.box[i]);
    if (!same) throw new CorruptFileError('GST-0207', offset, 'the directory says something else');
    const payload = await this.source.read(offset + head.headBytes, head.payload);
    const parts = decodeParts(head, payload, offset + head.headBytes);
    checkTriangles(head, parts, offset);
    return { ...head, parts };
  }
}

async function readHeader(source) {
  const refuse = (rule, at, said) => {
    throw new CorruptFileError(rule, at, said);
  };
  let data = await source.read(0, 65536);
  if (!MAGIC.every((byte, i) => data[i] === byte)) refuse('GST-0001', 0, 'no geometry stream');
  if (data.length < FIXED_BYTES) refuse('GST-0002', data.length, 'the header is cut');
  const view = viewOf(data);
  const needs = view.getUint16(12, true);
  if (needs > VERSION) throw new UnsupportedError(`needs a reader of version ${needs}`);
  const count = view.getUint16(28, true);
  const text = view.getUint32(32, true);
  if (count > 32 || text > 2 ** 20) refuse('GST-0004', 28, 'attributes or metadata above limits');
  const end = FIXED_BYTES + 32 * count + text;
  if (data.length < end + 4) data = await source.read(0, end + 4);
  if (data.length < end + 4) refuse('GST-0002', data.length, 'the header is cut');
  const crc = viewOf(data).getUint32(end, true);
  if (crc32(data.subarray(0, end)) !== crc) refuse('GST-0003', end, 'the header has another CRC');
  if (view.getUint32(16, true)) throw new UnsupportedError('has unknown incompatible features');
  if (!zeros(data, 30, 32)) refuse('GST-0005', 30, 'reserved bytes are not zero');
  const attributes = [];
  for (let at = FIXED_BYTES; at < end - text; at += 32) attributes.push(parseAttribute(data, at));
  if (new Set(attributes.map(({ id }) => id)).size !== count) {
    refuse('GST-0006', FIXED_BYTES, 'an attribute stands twice');
  }
  const metadata = parseJson(data.subarray(end - text, end), 'GST-0007', end - text);
  return { attributes, metadata, bytes: end + 4, crc };
}

function parseAttribute(data, at) {
  const view = viewOf(data);
  const [id, dtype, components] = [view.getUint16(at, true), data[at + 2], data[at + 3]];
  const name = String.fromCharCode(...data.subarray(at + 8, at + 32)).replace(/\0+$/, '');
  const known = ATTRIBUTES[id] ?? RESERVED[id];
  const strange = known && (known[0] !== name || known[1] !== dtype || known[2] !== components);
  if (id === 0 || strange || !/^[\x01-\x7f]*$/.test(name) || !zeros(data, at + 4, at + 8)) {
    throw new CorruptFileError('GST-0006', at, 'an attribute is not as the spec has it');
  }
  return { id, dtype, components, name };
}

function parseJson(bytes, rule, at) {
  const value = parseObject(bytes);
  if (value === undefined) throw new CorruptFileError(rule, at, 'this is no JSON object');
  return value;
}

async function readDirectory(source, header) {
  const size = source.size;
  if (size === undefined) throw new UnsupportedError('the length of the stream is not known');
  const at = size - TAIL_BYTES;
  const refuse = (rule, said) => {
    throw new CorruptFileError(rule, Math.max(at, 0), said);
  };
  const tail = await source.read(Math.max(at, 0), TAIL_BYTES);
  if (at < header.bytes || !MAGIC.every((byte, i) => tail[36 + i] === byte)) {
    refuse('GST-0201', 'there is no tail: the file is cut');
  }
  const view = viewOf(tail);
  if (crc32(tail.subarray(0, 32)) !== view.getUint32(32, true)) refuse('GST-0202', 'a broken tail');
  if (u64(view, 0) !== size) refuse('GST-0203', `the file has ${size} bytes`);
  const [offset, length] = [u64(view, 8), u64(view, 16)];
  if (offset + length !== at || length < 16) refuse('GST-0204', 'the directory is not before it');
  if (view.getUint32(28, true) !== header.crc) refuse('GST-0211', 'of another file than the header');
  const data = await source.read(offset, length);
  if (crc32(data) !== view.getUint32(24, true)) refuse('GST-0205', 'the directory is damaged');
  return parseDirectory(data, offset, header.bytes);
}

function parseDirectory(data, offset, begin) {
  const refuse = (rule, said) => {
    throw new CorruptFileError(rule, offset, said);
  };
  const view = viewOf(data);
  const [count, text] = [view.getUint32(4, true), view.getUint32(8, true)];
  if (count > 2 ** 24 || text > 2 ** 22) refuse('GST-0212', 'the directory is above a limit');
  const end = 16 + ROW_BYTES * count;
  const magic = view.getUint32(0, false) === 0x47444952;
  if (!magic || !zeros(data, 12, 16) || data.length !== end + text) {
    refuse('GST-0206', 'the directory is malformed');
  }
  const rows = [];
  let next = begin;
  for (let at = 16; at < end; at += ROW_BYTES) {
    const row = {
      offset: u64(view, at),
      length: view.getUint32(at + 8, true),
      triangles: view.getUint32(at + 12, true),
      vertices: view.getUint32(at + 16, true),
      source: view.getUint32(at + 20, true),
      box: Array.from({ length: 6 }, (_, i) => view.getFloat64(at + 24 + 8 * i, true)),
    };
    if (row.offset !== next) refuse('GST-0208', 'chunks leave a gap or overlap');
    next += row.length;
    rows.push(row);
  }
  if (next !== offset) refuse('GST-0208', 'chunks do not end where the directory begins');
  return { rows, totals: parseJson(data.subarray(end), 'GST-0209', offset + end) };
}
