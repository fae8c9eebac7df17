/**
 * The tables in the head of a block file: sections, columns, levels, pages; and the metadata.
 * Spec: sections 4 and 9.
 *
 * @typedef {import('./head.mjs').Head} Head
 * @typedef {import('./head.mjs').PageRecord} PageRecord
 */

import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { u64, viewOf, zeros } from './bytes.mjs';
import { isObject, parseObject } from './json.mjs';

export const TAIL_BYTES = 64;
export const ROW_BYTES = 32; // of every table, and of a column record
export const FIRST_SECTION = 256; // byte of the section table
export const PAGE_ENTRIES = 1024;

const MAX_PAGE_ROWS = 1400;
const MAX_META_BYTES = 12288;
const INSIDE = ['LEVL', 'COLM', 'PAGE', 'META'];

/** id: [name, components, bits, bytes of an item in the raw column]; other bits follow from the head. */
const COLUMNS = {
  1: ['occupancy', 1, 8, 1],
  2: ['mask', 1, 6, 1],
  3: ['normal', 2, undefined, 2],
  4: ['colour', 4, 8, 1],
  5: ['weight', 1, 32, 4],
  6: ['label', 1, 32, 4],
  7: ['spread', 1, 8, 1],
  32: ['vertex', 3, undefined, 4],
  33: ['triangle', 3, 32, 4],
};

/** The bodies of the four sections in the head, by type, and the rows of those behind the body. */
export function parseSections(bytes, view, head) {
  const refuse = (at, said) => {
    throw new CorruptFileError('GSB-0201', at, said);
  };
  const count = bytes[238];
  const end = bytes.length - 4;
  let first = FIRST_SECTION + ROW_BYTES * count;
  if (count < INSIDE.length || count > 16 || first > end) refuse(238, `${count} sections`);
  const rows = Array.from({ length: count }, (_, i) => {
    const at = FIRST_SECTION + ROW_BYTES * i;
    if (view.getUint32(at + 4, true) > 1 || !zeros(bytes, at + 28, at + 32)) {
      throw new CorruptFileError('GSB-0104', at, 'reserved bits of a section are not zero');
    }
    return {
      type: String.fromCharCode(...bytes.subarray(at, at + 4)),
      critical: bytes[at + 4] === 1,
      offset: u64(view, at + 8),
      length: u64(view, at + 16),
      crc: view.getUint32(at + 24, true),
    };
  });
  const inside = {};
  INSIDE.forEach((type, i) => {
    const row = rows[i];
    const lawful = row.type === type && row.critical && row.offset === first && row.crc === 0;
    if (!lawful || row.length > end - first) refuse(first, `here must be section ${type}`);
    inside[type] = { at: first, bytes: bytes.subarray(first, first + row.length) };
    first += row.length;
  });
  if (first !== end) refuse(first, 'the last section in the head does not end at its CRC');
  const sections = rows.slice(INSIDE.length);
  first = head.fileBytes - TAIL_BYTES - sections.reduce((sum, row) => sum + row.length, 0);
  if (first < bytes.length) refuse(FIRST_SECTION, 'sections are longer than the file');
  for (const section of sections) {
    if (section.critical) throw new UnsupportedError(`section ${section.type} is not known`);
    if (section.offset !== first) refuse(FIRST_SECTION, 'a section is not at the end of the body');
    first += section.length;
  }
  return { inside, sections };
}

export function parseColumns({ at, bytes }, count, head) {
  const refuse = (said) => {
    throw new CorruptFileError('GSB-0204', at, said);
  };
  if (count < 1 || count > 16 || bytes.length !== count * ROW_BYTES) refuse('no table of columns');
  const view = viewOf(bytes);
  const bitsOf = { 3: head.normalBits, 32: head.blockLog2 + head.snapBits + 1 };
  const columns = Array.from({ length: count }, (_, i) => {
    const row = i * ROW_BYTES;
    if (!zeros(bytes, row + 4, row + 8)) refuse('reserved bytes of a column are not zero');
    const column = {
      id: view.getUint16(row, true),
      name: paddedName(bytes.subarray(row + 8, row + 32), refuse),
      components: bytes[row + 2],
      bits: bytes[row + 3],
    };
    const known = COLUMNS[column.id];
    if (known) {
      const bits = known[2] ?? bitsOf[column.id];
      const same = column.name === known[0] && column.components === known[1];
      if (!same || column.bits !== bits) refuse(`column ${column.id} has another name or shape`);
    }
    return { ...column, itemBytes: known ? known[3] : 0 };
  });
  const ascend = columns.every(({ id }, i) => (i ? id > columns[i - 1].id : id === 1));
  const names = new Set(columns.map(({ name }) => name));
  if (!ascend || names.size !== count || names.has('')) refuse('ids or names are out of order');
  return columns;
}

function paddedName(bytes, refuse) {
  let length = bytes.length;
  while (length > 0 && bytes[length - 1] === 0) length--;
  try {
    return utf8(bytes.subarray(0, length));
  } catch {
    return refuse("a column's name is not UTF-8");
  }
}

function utf8(bytes) {
  return new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(bytes);
}

export function parseLevels({ at, bytes }, head) {
  const refuse = (said) => {
    throw new CorruptFileError('GSB-0203', at, said);
  };
  if (bytes.length !== head.levels * ROW_BYTES) refuse('no table of levels');
  const view = viewOf(bytes);
  const levels = [];
  let coarser = 0;
  for (let level = head.levels - 1; level >= 0; level--) {
    const row = level * ROW_BYTES;
    levels[level] = { blocks: u64(view, row), voxels: u64(view, row + 8) };
    if (u64(view, row + 16) !== coarser) refuse('a level does not begin where the coarser ones end');
    if (bytes[row + 24] !== head.blockLog2) refuse('a level has another block edge than the head');
    if (!zeros(bytes, row + 25, row + 32)) refuse('reserved bytes of a level are not zero');
    coarser += levels[level].blocks;
  }
  if (coarser !== head.blocks) refuse('the levels do not add up to the directory');
  return levels;
}

export function parsePageTable({ at, bytes }, head) {
  const rows = head.depth === 1 ? head.pages : Math.floor(bytes.length / ROW_BYTES);
  if (bytes.length !== rows * ROW_BYTES || rows > MAX_PAGE_ROWS) {
    throw new CorruptFileError('GSB-0206', at, `${bytes.length} bytes are no table of pages`);
  }
  return pageRecords(bytes, at, head, head.depth === 1 ? head.blocks : head.pages);
}

/**
 * Page records, in the head or in a table page, checked one by one.
 * @param {Uint8Array} bytes
 * @param {number} at where they stand in the file
 * @param {Head} head
 * @param {number | undefined} total what their counts must add up to, where that is known
 * @returns {PageRecord[]}
 */
export function pageRecords(bytes, at, head, total) {
  const refuse = (row, said) => {
    throw new CorruptFileError('GSB-0206', at + row, said);
  };
  const view = viewOf(bytes);
  const records = [];
  let sum = 0;
  for (let row = 0; row < bytes.length; row += ROW_BYTES) {
    const record = {
      level: bytes[row],
      count: view.getUint32(row + 4, true),
      key: u64(view, row + 8),
      offset: u64(view, row + 16),
      length: view.getUint32(row + 24, true),
      crc: view.getUint32(row + 28, true),
    };
    const { count, offset, length } = record;
    if (!zeros(bytes, row + 1, row + 4)) refuse(row, 'reserved bytes of a page are not zero');
    if (count < 1 || count > PAGE_ENTRIES) refuse(row, `a page of ${count} rows`);
    if (offset < head.headBytes || offset + length > head.bodyEnd) {
      refuse(row, 'a page is outside the body');
    }
    sum += count;
    records.push(record);
  }
  if (total !== undefined && sum !== total) refuse(0, `the pages hold ${sum} rows, not ${total}`);
  return records;
}

export function parseMetadata({ at, bytes }) {
  const refuse = (said) => {
    throw new CorruptFileError('GSB-0205', at, said);
  };
  if (bytes.length > MAX_META_BYTES) refuse(`metadata of ${bytes.length} bytes`);
  const metadata = parseObject(bytes);
  if (!isObject(metadata?.ledger)) refuse('the metadata is no JSON object with a ledger');
  for (const name of ['units', 'up', 'crs']) {
    const value = Object.hasOwn(metadata, name) ? metadata[name] : null;
    if (value !== null && typeof value !== 'string') refuse(`${name} is no string`);
  }
  return metadata;
}
