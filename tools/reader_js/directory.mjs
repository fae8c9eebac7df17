/** The directory of a block file: pages on demand, each checked before use. Spec: section 5. */

import { CorruptFileError } from './errors.mjs';
import { fromMorton, u64, viewOf, zeros } from './bytes.mjs';
import { crc32 } from './crc.mjs';
import { ROW_BYTES, pageRecords } from './tables.mjs';

export const EMPTY = 0;
export const DATA = 1;

const ENTRY_BYTES = 24; // without its column records
const MAX_RAW = 64 * 2 ** 20;
const CACHED_PAGES = 16;
const CODEC_RAW = 0;
const CODEC_LZ4 = 1;
const CODEC_CONSTANT = 2;

/**
 * @typedef {object} ColumnRecord
 * @property {number} offset
 * @property {number} stored bytes in the file
 * @property {number} raw bytes of the raw column
 * @property {number} crc
 * @property {number} constant
 * @property {number} codec
 * @property {number} filter
 *
 * @typedef {object} Entry
 * @property {number} key
 * @property {number} count
 * @property {number} level
 * @property {number} state
 * @property {number} children
 * @property {number[]} low
 * @property {number[]} high
 * @property {ColumnRecord[]} records in the order of the column table
 */

/**
 * Negative, 0 or positive as a stands before, at or behind b: levels from coarse to fine, then keys.
 * @param {{level: number, key: number}} a
 * @param {{level: number, key: number}} b
 */
export function compare(a, b) {
  return b.level - a.level || a.key - b.key;
}

/** The pages of an open file; the last ones used stay in memory. */
export class Directory {
  /**
   * @param {import('./head.mjs').Head} head
   * @param {(offset: number, length: number) => Promise<Uint8Array>} read exactly that many bytes
   */
  constructor(head, read) {
    this.head = head;
    this.read = read;
    this.entryBytes = ENTRY_BYTES + ROW_BYTES * head.columns.length;
    this.tables = new Map(head.depth === 1 ? [[0, head.pageTable]] : []);
    this.pages = new Map();
    this.firstPage = [0]; // of each table page
    if (head.depth === 2) {
      for (const { count } of head.pageTable) this.firstPage.push(this.firstPage.at(-1) + count);
    }
  }

  /**
   * Page records: of one table page, or at depth 1 all of them as table 0.
   * @param {number} number
   * @returns {Promise<import('./head.mjs').PageRecord[]>}
   */
  async table(number) {
    if (!this.tables.has(number)) {
      const record = this.head.pageTable[number];
      const bytes = await this.#checked(record, ROW_BYTES, 'GSB-0207', 'table page');
      const rows = pageRecords(bytes, record.offset, this.head);
      if (compare(rows[0], record) !== 0) {
        const said = 'the table page does not begin with the key that the head states';
        throw new CorruptFileError('GSB-0207', record.offset, said);
      }
      remember(this.tables, number, rows);
    }
    return this.tables.get(number);
  }

  /**
   * The record of one page.
   * @param {number} number of the page
   */
  async record(number) {
    let table = 0;
    while (this.head.depth === 2 && this.firstPage[table + 1] <= number) table++;
    return (await this.table(table))[number - this.firstPage[table]];
  }

  /**
   * The entries of one page, each checked on its own.
   * @param {number} number of the page
   * @returns {Promise<Entry[]>}
   */
  async page(number) {
    let entries = this.pages.get(number);
    if (!entries) {
      const record = await this.record(number);
      const bytes = await this.#checked(record, this.entryBytes, 'GSB-0301', 'page');
      entries = this.#entries(bytes, record);
    }
    remember(this.pages, number, entries);
    return entries;
  }

  /**
   * The entries of one level, in Morton order.
   * @param {number} level
   * @returns {AsyncGenerator<Entry>}
   */
  async *entries(level) {
    if (!this.head.levelTable[level]?.blocks) return;
    const last = await this.pageAt({ level, key: 2 ** 48 });
    for (let page = await this.pageAt({ level, key: 0 }); page <= last; page++) {
      for (const entry of await this.page(page)) if (entry.level === level) yield entry;
    }
  }

  /**
   * The entry of one block, or undefined; reads one page at most, and one table page at depth 2.
   * @param {number} level
   * @param {number} key
   */
  async find(level, key) {
    if (this.head.pages === 0) return undefined;
    const wanted = { level, key };
    const entries = await this.page(await this.pageAt(wanted));
    const row = lastAtOrBefore(entries, wanted);
    return row >= 0 && compare(entries[row], wanted) === 0 ? entries[row] : undefined;
  }

  /**
   * The last page that begins at or before a place; page 0 when none does.
   * @param {{level: number, key: number}} wanted
   */
  async pageAt(wanted) {
    const first = this.head.depth === 1 ? 0 : lastAtOrBefore(this.head.pageTable, wanted);
    const table = Math.max(0, first);
    const row = lastAtOrBefore(await this.table(table), wanted);
    return this.firstPage[table] + Math.max(0, row);
  }

  async #checked(record, rowBytes, rule, what) {
    const { count, offset, length } = record;
    if (length !== count * rowBytes) {
      throw new CorruptFileError(rule, offset, `a ${what} of ${count} rows has ${length} bytes`);
    }
    const bytes = await this.read(offset, length);
    if (crc32(bytes) !== record.crc) {
      throw new CorruptFileError(rule, offset, `the ${what} does not match its CRC`);
    }
    return bytes;
  }

  #entries(bytes, record) {
    const view = viewOf(bytes);
    const entries = [];
    for (let at = 0; at < bytes.length; at += this.entryBytes) {
      const entry = parseEntry(bytes, view, at, this.head.columns.length);
      if (at === 0 && compare(entry, record) !== 0) {
        const said = 'the page does not begin with the key that its record states';
        throw new CorruptFileError('GSB-0302', record.offset, said);
      }
      const refuse = (rule, said) => {
        const where = `block ${entry.key} of level ${entry.level}`;
        throw new CorruptFileError(rule, record.offset + at, `${where} ${said}`);
      };
      if (at > 0 && compare(entries.at(-1), entry) >= 0) refuse('GSB-0303', 'is out of order');
      if (!zeros(bytes, at + 22, at + 24) || bytes[at + 15] !== 0) {
        refuse('GSB-0309', 'has reserved bytes that are not zero');
      }
      for (let i = at + ENTRY_BYTES; i < at + this.entryBytes; i += ROW_BYTES) {
        if (!zeros(bytes, i + 26, i + 32)) refuse('GSB-0309', 'has a record with reserved bytes');
      }
      checkEntry(entry, this.head, refuse);
      entries.push(entry);
    }
    return entries;
  }
}

/** Put a value last in a map, and drop the first one, not used for longest, of too many. */
function remember(map, number, value) {
  map.delete(number);
  map.set(number, value);
  if (map.size > CACHED_PAGES) map.delete(map.keys().next().value);
}

function lastAtOrBefore(rows, wanted) {
  let low = 0;
  let high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (compare(rows[middle], wanted) <= 0) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

function parseEntry(bytes, view, at, columns) {
  return {
    key: u64(view, at),
    count: view.getUint32(at + 8, true),
    level: bytes[at + 12],
    state: bytes[at + 13],
    children: bytes[at + 14],
    low: [...bytes.subarray(at + 16, at + 19)],
    high: [...bytes.subarray(at + 19, at + 22)],
    records: Array.from({ length: columns }, (_, column) => {
      const row = at + ENTRY_BYTES + ROW_BYTES * column;
      return {
        offset: u64(view, row),
        stored: view.getUint32(row + 8, true),
        raw: view.getUint32(row + 12, true),
        crc: view.getUint32(row + 16, true),
        constant: view.getUint32(row + 20, true),
        codec: bytes[row + 24],
        filter: bytes[row + 25],
      };
    }),
  };
}

function checkEntry(entry, head, refuse) {
  const { key, count, level, state, children, low, high, records } = entry;
  const edge = 2 ** head.blockLog2;
  if (level >= head.levels || key >= 2 ** 48) refuse('GSB-0305', 'is outside the grid');
  const wide = Math.ceil(head.resolution / (edge * 2 ** level));
  if (fromMorton(key).some((place) => place >= wide)) refuse('GSB-0305', 'is outside the grid');
  if (state > DATA || low.some((place, axis) => place > high[axis] || high[axis] >= edge)) {
    refuse('GSB-0305', 'has an impossible state or bounds');
  }
  if (level === 0 && children !== 0) refuse('GSB-0305', 'has children at level 0');
  if (level !== 0 && children === 0) refuse('GSB-0306', 'has no children above level 0');
  if (count > edge ** 3 || (state === DATA && count === 0)) {
    refuse('GSB-0409', 'has no voxels, or more than its volume');
  }
  if (state === EMPTY) {
    const places = [...low, ...high, count];
    const nothing = records.every((record) => Object.values(record).every((value) => value === 0));
    if (!nothing || places.some((value) => value !== 0)) {
      refuse('GSB-0308', 'is empty and yet has voxels, bounds or columns');
    }
    return;
  }
  records.forEach((record, i) => {
    if (isImpossible(record, head)) {
      refuse('GSB-0311', `has an impossible record of column ${head.columns[i].name}`);
    }
  });
}

/** Whether no writer makes such a record, whatever the stored bytes are; unknown codecs pass. */
function isImpossible({ offset, stored, raw, crc, constant, codec }, head) {
  if (raw < 1 || raw > MAX_RAW) return true;
  if (stored === 0 && (offset !== 0 || crc !== 0)) return true;
  if (codec === CODEC_CONSTANT && stored !== 0) return true;
  if ((codec === CODEC_RAW || codec === CODEC_LZ4) && (stored === 0 || constant !== 0)) return true;
  return stored !== 0 && (offset < head.headBytes || offset + stored > head.bodyEnd);
}
