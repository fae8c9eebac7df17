/** One column of one block: stored bytes -> values, every rule checked first. Spec: section 7. */

import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { ARRAYS, FILTERS, filteredBytes, hasPadding, undoFilter } from './filters.mjs';
import { unpackLz4 } from './lz4.mjs';
import { expandOctree, treeLevels } from './octree.mjs';

const RAW = 0;
const LZ4 = 1;
const CONSTANT = 2;
const MAX_RAW = 64 * 2 ** 20;

export const VERTEX = 32; // ids of the columns of source triangles
export const TRIANGLE = 33;

/**
 * @typedef {import('./head.mjs').Column} Column
 * @typedef {import('./directory.mjs').ColumnRecord} ColumnRecord
 * @typedef {Uint8Array | Uint16Array | Uint32Array} Values
 */

/**
 * Items of a column: one per voxel, but of source triangles and their vertices as many as are stored.
 * @param {Column} column
 * @param {ColumnRecord} record
 * @param {number} count of voxels
 */
export function itemsOf({ id, components, itemBytes }, { codec, raw }, count) {
  if (id < VERTEX) return count;
  return codec === CONSTANT ? 0 : Math.floor(raw / (components * itemBytes));
}

/**
 * Refuse a column whose record cannot be decoded, before a byte of it is fetched.
 * @param {Column} column
 * @param {ColumnRecord} record
 * @param {number} count of voxels
 * @param {number} blockLog2
 * @returns {number} the filtered length, in bytes
 */
export function checkRecord(column, record, count, blockLog2) {
  const { name, components, bits, itemBytes } = column;
  const { codec, filter, raw, stored, constant, offset } = record;
  const refuse = (rule, said) => {
    throw new CorruptFileError(rule, offset, `column ${name} ${said}`);
  };
  if (itemBytes === 0 || codec > CONSTANT || filter >= FILTERS) {
    throw new UnsupportedError(`column ${name} is of a kind, codec or filter that is not known`);
  }
  const tree = name === 'occupancy';
  const lawful = tree || codec === CONSTANT ? filter === 0 : filter !== 5 || components === 4;
  if (!lawful || (tree && codec === CONSTANT)) {
    refuse('GSB-0404', `may not have filter ${filter} with codec ${codec}`);
  }
  const items = itemsOf(column, record, count);
  // A node of the octree has a voxel below it, on each of the levels.
  const fits = tree
    ? raw >= blockLog2 && raw <= blockLog2 * count
    : raw === (items * components * itemBytes || (codec === CONSTANT ? 1 : -1));
  if (!fits) refuse('GSB-0402', `of ${count} voxels states ${raw} raw bytes`);
  if (items === 0 && constant !== 0) refuse('GSB-0403', `has no items and the constant ${constant}`);
  if (codec === CONSTANT) {
    const packed = 8 * itemBytes * components;
    const value = constantItems(column, constant);
    if ((packed < 32 && constant >= 2 ** packed) || value.some((item) => item >= 2 ** bits)) {
      refuse('GSB-0403', `has the constant ${constant}, which is out of range`);
    }
    if (stored !== 0) refuse('GSB-0403', 'is constant and has stored bytes');
    return 0;
  }
  const length = tree ? raw : filteredBytes(filter, items, column);
  const most = codec === RAW ? stored : 255 * stored + 64;
  if (length > MAX_RAW || length > most || (codec === RAW && length !== stored)) {
    refuse('GSB-0401', `cannot have ${length} bytes out of ${stored} stored ones`);
  }
  return length;
}

function constantItems({ components, itemBytes }, constant) {
  const bits = 8 * itemBytes;
  return Array.from({ length: components }, (_, c) => {
    return Math.floor(constant / 2 ** (bits * c)) % 2 ** bits;
  });
}

/**
 * The values of a column, the components of an item side by side; of occupancy, the local Morton codes.
 * @param {Column} column
 * @param {ColumnRecord} record
 * @param {Uint8Array} stored whose CRC the caller has checked
 * @param {number} count of voxels
 * @param {number} blockLog2
 * @returns {Values}
 */
export function decodeColumn(column, record, stored, count, blockLog2) {
  const { codec, filter, constant, offset } = record;
  const refuse = (rule, said) => {
    throw new CorruptFileError(rule, offset, `column ${column.name}: ${said}`);
  };
  const length = checkRecord(column, record, count, blockLog2);
  const items = itemsOf(column, record, count);
  if (codec === CONSTANT) return repeated(column, constantItems(column, constant), items);
  const data = codec === LZ4 ? unpackLz4(stored, length) : stored;
  if (data === null || data.length !== length) {
    refuse('GSB-0401', `the stored bytes do not unpack to ${length}`);
  }
  if (column.name === 'occupancy') {
    const levels = treeLevels(data, blockLog2);
    if (levels === null || levels.at(-1) !== count) {
      if (data.includes(0)) refuse('GSB-0407', 'a mask of the octree has no child');
      refuse('GSB-0408', `the masks are not the octree of ${count} voxels`);
    }
    return expandOctree(data, levels);
  }
  if (filter >= 2 && hasPadding(data, items)) {
    refuse('GSB-0406', 'bits behind the last value of a bit plane are set');
  }
  const values = undoFilter(filter, data, items, column);
  if (filter < 2 && column.bits < 8 * column.itemBytes) {
    if (values.some((value) => value >> column.bits)) {
      refuse('GSB-0405', `a value has more than ${column.bits} bits`);
    }
  }
  return values;
}

function repeated({ components, itemBytes }, items, count) {
  const values = new ARRAYS[itemBytes](count * components);
  if (components === 1) return values.fill(items[0]);
  for (let i = 0; i < values.length; i++) values[i] = items[i % components];
  return values;
}

/**
 * Refuse triangles that have a vertex which is not there.
 * @param {Uint32Array} triangles
 * @param {number} vertices
 */
export function checkNumbers(triangles, vertices) {
  if (triangles.some((vertex) => vertex >= vertices)) {
    throw new CorruptFileError('GSB-0413', 0, `a triangle has a vertex beyond the ${vertices}`);
  }
}
