/** One chunk of a geometry stream: head, part records, values. Spec: spec/stream.md, sections 4 and 5. */

import { CorruptFileError } from './errors.mjs';
import { viewOf, zeros } from './bytes.mjs';
import { crc32 } from './crc.mjs';
import { unpackLz4 } from './lz4.mjs';
import { cornerBases, edgeCodes, firstUse, undoDeltas } from './stream_filters.mjs';

export const MAX_HEAD_BYTES = 84 + 20 * 32;

const MAX_COUNT = 65536; // of triangles, of vertices
const MAX_PARTS = 32;
const MAX_RAW = 64 * 2 ** 20;
const INDEX = 0;
const VERTEX = 0;
const EDGES = 6;

/** id: [name, dtype, components, domains, filters] of what this version reads; index comes first. */
export const ATTRIBUTES = {
  0: ['index', 2, 1, [1], [0, 3, 6]],
  1: ['position', 4, 3, [0], [0, 2, 5]],
  2: ['position', 5, 3, [0], [0, 2, 5]],
  3: ['normal', 4, 3, [0], [0, 2, 5]],
  4: ['colour', 1, 4, [0, 2, 3], [0, 1, 4]],
};

/** dtype: [bytes, array] */
const DTYPES = {
  1: [1, Uint8Array],
  2: [2, Uint16Array],
  3: [4, Uint32Array],
  4: [4, Float32Array],
  5: [8, Float64Array],
};

/**
 * @typedef {object} Part
 * @property {number} attribute
 * @property {number} domain
 * @property {number} filter
 * @property {number} codec
 * @property {number} stored
 * @property {number} raw
 * @property {number} crc
 *
 * @typedef {object} ChunkHead
 * @property {number} headBytes
 * @property {number} indexBytes
 * @property {number} triangles
 * @property {number} vertices
 * @property {number} source
 * @property {number} payload bytes
 * @property {number} nonFinite
 * @property {number} degenerate
 * @property {number[]} box low x y z, high x y z
 * @property {Part[]} parts
 *
 * @typedef {object} Values
 * @property {number} attribute
 * @property {string} name
 * @property {number} domain 0 vertex, 1 corner, 2 triangle, 3 chunk
 * @property {Uint8Array | Uint16Array | Float32Array | Float64Array | null} values null where the
 *   attribute, its domain, codec or filter is not known, or indices that it goes by are not
 */

/**
 * Parse and check the head at the start of `data`, which lies at byte `at` of the file.
 * @param {Uint8Array} data
 * @param {number} at
 * @returns {ChunkHead}
 */
export function parseChunkHead(data, at) {
  const refuse = (rule, said) => {
    throw new CorruptFileError(rule, at, said);
  };
  if (data.length < 84) refuse('GST-0102', 'the file ends inside the head of a chunk');
  const view = viewOf(data);
  if (view.getUint32(0, false) !== 0x43484e4b) refuse('GST-0101', 'no chunk begins here');
  const parts = view.getUint16(6, true);
  if (parts > MAX_PARTS) refuse('GST-0104', `${parts} parts`);
  const headBytes = 84 + 20 * parts;
  if (data.length < headBytes) refuse('GST-0102', 'the file ends inside the head of a chunk');
  const crc = view.getUint32(headBytes - 4, true);
  if (crc32(data.subarray(0, headBytes - 4)) !== crc) refuse('GST-0103', 'a head has another CRC');
  const head = {
    headBytes,
    indexBytes: view.getUint16(4, true),
    triangles: view.getUint32(8, true),
    vertices: view.getUint32(12, true),
    source: view.getUint32(16, true),
    payload: view.getUint32(20, true),
    nonFinite: view.getUint32(24, true),
    degenerate: view.getUint32(28, true),
    box: Array.from({ length: 6 }, (_, i) => view.getFloat64(32 + 8 * i, true)),
    parts: Array.from({ length: parts }, (_, i) => parsePart(data, view, 80 + 20 * i, refuse)),
  };
  checkChunkHead(head, refuse);
  return head;
}

function parsePart(data, view, at, refuse) {
  if (!zeros(data, at + 5, at + 8)) refuse('GST-0106', 'reserved bytes of a part are not zero');
  const part = {
    attribute: view.getUint16(at, true),
    domain: data[at + 2],
    filter: data[at + 3],
    codec: data[at + 4],
    stored: view.getUint32(at + 8, true),
    raw: view.getUint32(at + 12, true),
    crc: view.getUint32(at + 16, true),
  };
  if (Math.max(part.stored, part.raw) > MAX_RAW) refuse('GST-0104', 'a part is above 64 MiB');
  return part;
}

function checkChunkHead(head, refuse) {
  const { indexBytes, triangles, vertices, parts } = head;
  if (triangles > MAX_COUNT || vertices > MAX_COUNT) refuse('GST-0104', 'a chunk is too large');
  if (head.payload !== parts.reduce((sum, { stored }) => sum + stored, 0)) {
    refuse('GST-0105', 'the parts do not add up to the payload');
  }
  if (indexBytes !== 0 && indexBytes !== 2) refuse('GST-0107', `indices of ${indexBytes} bytes`);
  const ids = parts.map(({ attribute }) => attribute);
  if (new Set(ids).size !== ids.length || ids.includes(1) === ids.includes(2)) {
    refuse('GST-0108', 'there is not one position part, or an attribute stands twice');
  }
  if (ids.indexOf(INDEX) !== (indexBytes === 2 ? 0 : -1)) {
    refuse('GST-0108', 'an index part must come first, and only where there are indices');
  }
  if (indexBytes === 0 && vertices !== 3 * triangles) {
    refuse('GST-0109', 'a chunk without indices does not have three vertices per triangle');
  }
  if (!head.box.every(Number.isFinite)) refuse('GST-0115', 'a box is not finite');
  if (head.degenerate > triangles) refuse('GST-0116', 'more degenerate triangles than triangles');
}

/**
 * Unpack all parts of a chunk that this version knows; of the others only the CRC is looked at, and
 * an unknown part spoils no other.
 * @param {ChunkHead} head
 * @param {Uint8Array} payload
 * @param {number} at where the payload lies in the file
 * @returns {Values[]}
 */
export function decodeParts(head, payload, at) {
  const found = [];
  let index = null;
  let begin = 0;
  for (const part of head.parts) {
    const stored = payload.subarray(begin, begin + part.stored);
    const refuse = (rule, said) => {
      throw new CorruptFileError(rule, at + begin, `attribute ${part.attribute}: ${said}`);
    };
    if (crc32(stored) !== part.crc) refuse('GST-0111', 'the CRC is wrong');
    const values = isKnown(part, found) ? decodePart(head, part, stored, index, refuse) : null;
    if (part.attribute === INDEX) index = values;
    const name = ATTRIBUTES[part.attribute]?.[0];
    found.push({ attribute: part.attribute, name, domain: part.domain, values });
    begin += part.stored;
  }
  return found;
}

function isKnown({ attribute, domain, filter, codec }, found) {
  const [, , , domains, filters] = ATTRIBUTES[attribute] ?? [];
  const near = filter === 4 || filter === 5;
  if (near && found[0]?.attribute === INDEX && found[0].values === null) return false;
  return codec <= 2 && Boolean(domains?.includes(domain)) && filters.includes(filter);
}

function decodePart(head, part, stored, index, refuse) {
  const { attribute, domain, filter, codec } = part;
  const [, dtype, components] = ATTRIBUTES[attribute];
  const [width, array] = DTYPES[dtype];
  const count = [head.vertices, 3 * head.triangles, head.triangles, 1][domain];
  const data = unpack(head, part, stored, count * components * width, components * width, refuse);
  if (filter === 0) {
    const all = codec === 2 ? repeated(data, data.length * count) : data.slice();
    const values = new array(all.buffer);
    if (attribute === INDEX && values.some((vertex) => vertex >= head.vertices)) {
      refuse('GST-0112', 'an index is not below the number of vertices');
    }
    return values;
  }
  if (attribute === INDEX) {
    const { triangles, vertices } = head;
    const found = filter === EDGES ? edgeCodes(data, triangles, vertices) : firstUse(data, vertices);
    return found ?? refuse('GST-0114', 'the codes are broken or leave vertices unused');
  }
  const near = filter === 4 || filter === 5;
  if (near && (index === null || domain !== VERTEX)) refuse('GST-0107', 'no indices to go by');
  const bases = near ? cornerBases(index, head.vertices) : null;
  const ordered = filter === 2 || filter === 5;
  return new array(undoDeltas(data, count, components, width, ordered, bases));
}

/** The bytes of a part before its filter is undone, as many as there must be. */
function unpack(head, { codec, filter, raw }, stored, whole, single, refuse) {
  let wanted = codec === 2 ? single : whole;
  const codes = raw - head.triangles; // bytes behind one code per triangle
  if (filter === EDGES && codes >= 0 && codes <= whole && codes % 2 === 0) wanted = raw;
  if (raw !== wanted || (codec === 2 && filter !== 0)) refuse('GST-0107', `${raw} bytes do not fit`);
  if (codec !== 1) {
    if (stored.length !== raw) refuse('GST-0107', 'a part that is not packed has another length');
    return stored;
  }
  const data = raw <= 255 * stored.length + 64 ? unpackLz4(stored, raw) : null;
  return data ?? refuse('GST-0113', `the LZ4 block does not unpack to ${raw} bytes`);
}

function repeated(one, length) {
  const all = new Uint8Array(length);
  for (let i = 0; i < length; i++) all[i] = one[i % one.length];
  return all;
}

/**
 * Refuse a chunk whose box or count of degenerate triangles is not that of its triangles.
 * @param {ChunkHead} head
 * @param {Values[]} found
 * @param {number} at where the chunk lies in the file
 */
export function checkTriangles(head, found, at) {
  const points = found.find(({ name }) => name === 'position')?.values;
  const index = found.find(({ name }) => name === 'index');
  if (!points) return;
  const box = [0, 1, 2, 3, 4, 5].map((i) => extreme(points, i % 3, i < 3 ? -1 : 1));
  if (!box.every((value, i) => Object.is(value, head.box[i]))) {
    throw new CorruptFileError('GST-0117', at + 32, 'the box is not that of the vertices');
  }
  if (index?.values === null) return;
  let degenerate = 0;
  for (let t = 0; t < head.triangles; t++) {
    const [a, b, c] = [3 * t, 3 * t + 1, 3 * t + 2].map((corner) => 3 * (index?.values[corner] ?? corner));
    const same = (p, q) => [0, 1, 2].every((axis) => points[p + axis] === points[q + axis]);
    degenerate += same(a, b) || same(b, c) || same(c, a);
  }
  if (degenerate !== head.degenerate) {
    throw new CorruptFileError('GST-0116', at + 28, `${degenerate} triangles are degenerate`);
  }
}

/** The least or greatest coordinate on an axis, NaN if there is one; a zero is +0, and so is none. */
function extreme(points, axis, sign) {
  if (points.length === 0) return 0;
  let found = points[axis];
  for (let i = axis; i < points.length; i += 3) {
    if (Number.isNaN(points[i])) return NaN;
    if (sign * (points[i] - found) > 0) found = points[i];
  }
  return found + 0;
}
