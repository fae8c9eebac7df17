/** Head and tail of a block file: their fixed fields. The tables are in tables.mjs. Spec: section 3. */

import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { u64, viewOf, zeros } from './bytes.mjs';
import { crc32 } from './crc.mjs';
import {
  parseColumns,
  parseLevels,
  parseMetadata,
  parsePageTable,
  parseSections,
  FIRST_SECTION,
  TAIL_BYTES,
} from './tables.mjs';

export const MAX_HEAD_BYTES = 65536;

const MAGIC = '\x89GSB 1.0\r\n\x1a\n';
const TAIL_MAGIC = '\x89GSBTAIL\r\n\x1a\n';
const VERSION = 1;
const MAX_BLOCKS = 2 ** 24;

/**
 * @typedef {object} Column
 * @property {number} id
 * @property {string} name
 * @property {number} components
 * @property {number} bits of each component
 * @property {number} itemBytes of each component, decoded; 0 for a column of an unknown kind
 *
 * @typedef {object} Level
 * @property {number} blocks
 * @property {number} voxels
 *
 * @typedef {object} PageRecord
 * @property {number} level of the first entry
 * @property {number} key of the first entry
 * @property {number} count of entries, or of rows of a table page
 * @property {number} offset
 * @property {number} length
 * @property {number} crc
 *
 * @typedef {object} Section one of those behind the body
 * @property {string} type
 * @property {number} offset
 * @property {number} length
 * @property {number} crc
 *
 * @typedef {object} Head
 * @property {number} headBytes
 * @property {number} fileBytes
 * @property {number} bodyEnd where pages and payloads end
 * @property {Uint8Array} contentId 16 bytes
 * @property {number} crc of the head
 * @property {number} resolution voxels per axis of level 0
 * @property {number} snapBits
 * @property {number} levels
 * @property {number} blockLog2 a block has 2^blockLog2 voxels per axis
 * @property {number} separability 1, 6 or 26
 * @property {number} ties
 * @property {number} faces
 * @property {number} normals
 * @property {number} lodWeighting
 * @property {number} normalBits
 * @property {number[]} matrix 12 reals, 3 x 4 row-major: voxel index of level 0 -> world
 * @property {number[]} box 6 reals: low x y z, high x y z of the source in the world
 * @property {number} blocks
 * @property {number} openingBytes
 * @property {number} pages
 * @property {number} depth of the page table, 1 or 2
 * @property {Level[]} levelTable level 0 first
 * @property {Column[]} columns
 * @property {PageRecord[]} pageTable pages at depth 1, table pages at depth 2
 * @property {Record<string, any>} metadata
 * @property {Section[]} sections
 */

/**
 * Parse and check the head.
 * @param {Uint8Array} data the first 64 KiB of the file, or all of a smaller one
 * @returns {Head}
 */
export function parseHead(data) {
  const bytes = identified(data);
  const view = viewOf(bytes);
  const head = {
    headBytes: bytes.length,
    fileBytes: u64(view, 32),
    contentId: bytes.slice(40, 56),
    crc: view.getUint32(bytes.length - 4, true),
    ...settings(view),
    blocks: u64(view, 216),
    openingBytes: u64(view, 224),
    pages: view.getUint32(232, true),
    depth: bytes[236],
  };
  within('blocks', head.blocks, 0, MAX_BLOCKS, 216);
  within('pages', head.pages, 0, head.blocks, 232);
  within('the depth of the page table', head.depth, 1, 2, 236);
  const { inside, sections } = parseSections(bytes, view, head);
  const behind = sections.reduce((sum, section) => sum + section.length, 0);
  head.bodyEnd = head.fileBytes - TAIL_BYTES - behind;
  head.sections = sections;
  head.columns = parseColumns(inside.COLM, bytes[237], head);
  head.levelTable = parseLevels(inside.LEVL, head);
  head.pageTable = parsePageTable(inside.PAGE, head);
  head.metadata = parseMetadata(inside.META);
  if (head.openingBytes > head.bodyEnd - head.headBytes) {
    throw new CorruptFileError('GSB-0310', 224, 'the opening run reaches beyond the body');
  }
  return head;
}

/** The bytes of the head, once magic, length, CRC, version, features and spare bytes are checked. */
function identified(data) {
  if (!startsWith(data, MAGIC)) {
    throw new CorruptFileError('GSB-0101', 0, 'this is no block file: the magic is missing');
  }
  if (data.length < FIRST_SECTION) throw cut(data.length, 'the file ends inside its head');
  const length = viewOf(data).getUint32(28, true);
  if (length < FIRST_SECTION || length > MAX_HEAD_BYTES) {
    throw new CorruptFileError('GSB-0103', 28, `a head cannot have ${length} bytes`);
  }
  if (data.length < length) throw cut(data.length, 'the file ends inside its head');
  const bytes = data.subarray(0, length);
  const view = viewOf(bytes);
  if (crc32(bytes.subarray(0, -4)) !== view.getUint32(length - 4, true)) {
    throw new CorruptFileError('GSB-0103', length - 4, 'the head does not match its CRC');
  }
  const needs = view.getUint16(12, true);
  const features = view.getUint32(16, true);
  if (needs > VERSION || features !== 0) {
    throw new UnsupportedError(`needs a reader of version ${needs} with features ${features}`);
  }
  if (!zeros(bytes, 69, 72) || !zeros(bytes, 239, 256)) {
    throw new CorruptFileError('GSB-0104', 69, 'reserved bytes of the head are not zero');
  }
  const fileBytes = u64(view, 32);
  if (fileBytes < length + TAIL_BYTES) throw cut(32, `the file cannot have ${fileBytes} bytes`);
  return bytes;
}

function startsWith(data, magic) {
  return [...magic].every((letter, i) => data[i] === letter.charCodeAt(0));
}

/** @returns {CorruptFileError} */
export function cut(at, said) {
  return new CorruptFileError('GSB-0102', at, `${said}: truncated`);
}

function within(what, value, least, most, at) {
  if (value < least || value > most) {
    throw new CorruptFileError('GSB-0105', at, `${what}: ${value} is not ${least} to ${most}`);
  }
}

/** Bytes 56 to 215: the settings the file was made with. */
function settings(view) {
  const reals = Array.from({ length: 18 }, (_, i) => view.getFloat64(72 + 8 * i, true));
  const made = {
    resolution: view.getUint32(56, true),
    snapBits: view.getUint8(60),
    levels: view.getUint8(61),
    blockLog2: view.getUint8(62),
    separability: view.getUint8(63),
    ties: view.getUint8(64),
    faces: view.getUint8(65),
    normals: view.getUint8(66),
    lodWeighting: view.getUint8(67),
    normalBits: view.getUint8(68),
    matrix: reals.slice(0, 12),
    box: reals.slice(12),
  };
  within('resolution', made.resolution, 1, 65536, 56);
  within('snap bits', made.snapBits, 0, 16, 60);
  within('levels', made.levels, 1, 17, 61);
  within('block edge', made.blockLog2, 3, 8, 62);
  within('normal bits', made.normalBits, 8, 12, 68);
  if (![1, 6, 26].includes(made.separability)) {
    throw new CorruptFileError('GSB-0105', 63, `separability ${made.separability} is no code`);
  }
  ['ties', 'faces', 'normals', 'lodWeighting'].forEach((name, i) => {
    within(name, made[name], 0, 1, 64 + i);
  });
  checkPlaces(made.matrix, made.box);
  return made;
}

function checkPlaces(matrix, box) {
  const scale = Math.max(...[0, 1, 2, 4, 5, 6, 8, 9, 10].map((i) => Math.abs(matrix[i])));
  const [a, b, c, , d, e, f, , g, h, i] = matrix.map((value) => value / scale);
  const volume = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g);
  if (!matrix.every(Number.isFinite) || !volume) {
    throw new CorruptFileError('GSB-0106', 72, 'the matrix is not finite or has no inverse');
  }
  if (!box.every(Number.isFinite) || [0, 1, 2].some((axis) => box[axis] > box[axis + 3])) {
    throw new CorruptFileError('GSB-0106', 168, 'the source box is not finite or inside out');
  }
}

/**
 * Refuse a tail that does not repeat the head: then the file is cut, or the end of another.
 * @param {Uint8Array} tail the last 64 bytes of the file
 * @param {Head} head
 */
export function checkTail(tail, head) {
  const view = viewOf(tail);
  const same =
    tail.length === TAIL_BYTES &&
    startsWith(tail, TAIL_MAGIC) &&
    u64(view, 12) === head.fileBytes &&
    head.contentId.every((byte, i) => tail[20 + i] === byte) &&
    view.getUint32(36, true) === head.crc &&
    zeros(tail, 40, 60) &&
    view.getUint32(60, true) === crc32(tail.subarray(0, 60));
  if (!same) throw cut(head.fileBytes - TAIL_BYTES, 'the tail does not match the head');
}
