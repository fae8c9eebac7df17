/**
 * Reading a whole block file, with the checks that need more than one block: tail, order, tree, places.
 * Not here: levels of detail recomputed, ledger, content id, which only a validator looks at.
 */

import { TRIANGLE, VERTEX, checkNumbers, itemsOf } from './columns.mjs';
import { CorruptFileError, UnsupportedError } from './errors.mjs';
import { crc32 } from './crc.mjs';
import { compare } from './directory.mjs';
import { checkTail } from './head.mjs';
import { areCanonical } from './normals.mjs';
import { Block } from './reader.mjs';
import { TAIL_BYTES } from './tables.mjs';

const PIECE = 2 ** 20; // bytes read at once of a section that is only summed up
const OPENING_BYTES = 4 * 2 ** 20; // what the opening run should not exceed

/**
 * Decode every column of every block, in the order of the directory; throws at the first broken rule.
 * @param {import('./reader.mjs').BlockFile} file
 * @param {(block: Block, name: string, values: import('./columns.mjs').Values | null) => void} visit
 *   called with null for a column of an unknown kind, codec or filter, of which only the CRC is checked
 */
export async function readWhole(file, visit = () => {}) {
  const { head } = file;
  checkTail(await file.read(head.fileBytes - TAIL_BYTES, TAIL_BYTES), head);
  for (const section of head.sections) await checkSection(file, section);
  await checkBody(file);
  for (let level = 0; level + 1 < head.levels; level++) await checkFamilies(file, level);
  for (let level = head.levels - 1; level >= 0; level--) {
    for await (const block of file.blocks(level)) await readBlock(block, visit);
  }
}

async function checkSection(file, { type, offset, length, crc }) {
  let sum = 0;
  for (let at = 0; at < length; at += PIECE) {
    sum = crc32(await file.read(offset + at, Math.min(PIECE, length - at)), sum);
  }
  if (sum !== crc) throw new CorruptFileError('GSB-0202', offset, `section ${type} has another CRC`);
}

/** Pages and payloads stand one behind the other, and their entries add up to the level table. */
async function checkBody(file) {
  const { head, directory } = file;
  const levels = head.levelTable.map(() => ({ blocks: 0, voxels: 0 }));
  let at = head.headBytes;
  let last;
  for (const [kind, number] of partsOf(file)) {
    if (kind === 'payloads') {
      const entries = await directory.page(number);
      const end = checkPayloads(entries, head, at);
      if (number === 0) checkOpening(entries, head, at - head.headBytes);
      for (const { level, count } of entries) {
        levels[level].blocks += 1;
        levels[level].voxels += count;
      }
      at = end;
      continue;
    }
    const record = kind === 'table' ? head.pageTable[number] : await directory.record(number);
    if (record.offset !== at) {
      const said = `a ${kind} of the directory stands at ${record.offset}`;
      throw new CorruptFileError('GSB-0312', at, said);
    }
    if (kind === 'page') {
      const entries = await directory.page(number);
      if (last) checkSeam(last, entries[0], at);
      last = entries.at(-1);
    }
    at += record.length;
  }
  if (at !== head.bodyEnd) throw new CorruptFileError('GSB-0312', at, 'the body ends here');
  levels.forEach(({ blocks, voxels }, level) => {
    const stated = head.levelTable[level];
    if (blocks !== stated.blocks || voxels !== stated.voxels) {
      const said = `level ${level} has ${blocks} blocks and ${voxels} voxels`;
      throw new CorruptFileError('GSB-0203', 0, said);
    }
  });
}

/** The body in file order: a table page, a page, its payloads, then the same of all others. */
function* partsOf({ head }) {
  const tables = head.depth === 2 ? head.pageTable.length : 0;
  for (const [first, end] of [[0, 1], [1, Infinity]]) {
    for (let i = first; i < Math.min(end, tables); i++) yield ['table', i];
    for (let i = first; i < Math.min(end, head.pages); i++) yield ['page', i];
    for (let i = first; i < Math.min(end, head.pages); i++) yield ['payloads', i];
  }
}

function isSibling(a, b) {
  return a.level === b.level && Math.floor(a.key / 8) === Math.floor(b.key / 8);
}

function checkSeam(last, first, at) {
  if (compare(last, first) >= 0) {
    throw new CorruptFileError('GSB-0303', at, 'the page begins before the last one ends');
  }
  if (isSibling(last, first)) {
    throw new CorruptFileError('GSB-0304', at, 'a sibling group is split by two pages');
  }
}

/** Sibling groups of entries in order. */
function* groupsOf(entries) {
  for (let first = 0, end = 0; first < entries.length; first = end) {
    while (end < entries.length && isSibling(entries[first], entries[end])) end++;
    yield entries.slice(first, end);
  }
}

/** Where the payloads of a page end, if each is where the order of payloads puts it. */
function checkPayloads(entries, head, begin) {
  let at = begin;
  for (const group of groupsOf(entries)) {
    head.columns.forEach(({ name }, column) => {
      for (const { key, level, records } of group) {
        const { offset, stored } = records[column];
        if (offset !== (stored ? at : 0)) {
          const said = `column ${name} of block ${key}, level ${level}, is not here`;
          throw new CorruptFileError('GSB-0312', at, said);
        }
        at += stored;
      }
    });
  }
  return at;
}

function checkOpening(entries, head, before) {
  let end = before;
  let opening = 0;
  for (let level = entries[0].level; level >= 0; level--) {
    const here = entries.filter((entry) => entry.level === level);
    for (const { records } of here) for (const { stored } of records) end += stored;
    const whole = here.length === head.levelTable[level].blocks;
    if (opening !== 0 && (!whole || end > OPENING_BYTES)) break;
    opening = end;
  }
  if (opening !== head.openingBytes) {
    const said = `the opening run has ${opening} bytes, not ${head.openingBytes}`;
    throw new CorruptFileError('GSB-0310', 224, said);
  }
}

/** Every group of siblings has a parent that lists just these, and no parent is childless. */
async function checkFamilies(file, level) {
  const parents = file.directory.entries(level + 1);
  let { value: parent, done } = await parents.next();
  let children = 0;
  const close = async () => {
    if (children !== parent.children || children === 0) {
      const said = `block ${parent.key} of level ${level + 1} has the children ${children}`;
      throw new CorruptFileError('GSB-0306', 0, said);
    }
    children = 0;
    ({ value: parent, done } = await parents.next());
  };
  for await (const { key } of file.directory.entries(level)) {
    const above = Math.floor(key / 8);
    while (!done && parent.key < above) await close();
    if (done || parent.key > above) {
      const said = `block ${key} of level ${level} has no parent`;
      throw new CorruptFileError('GSB-0307', 0, said);
    }
    children |= 1 << (key % 8);
  }
  while (!done) await close();
}

async function readBlock(block, visit) {
  const { columns } = block.file.head;
  const at = columns.findIndex(({ id }) => id === VERTEX);
  const vertices = at < 0 ? 0 : itemsOf(columns[at], block.entry.records[at], block.count);
  for (const { id, name, bits } of columns) {
    await block.stored(name);
    const values = await columnOrNull(block, name);
    if (values === null) {
      visit(block, name, null);
      continue;
    }
    if (name === 'occupancy') checkPlaces(block, values);
    if (id === TRIANGLE) checkNumbers(values, vertices);
    if (!isMeaningful(name, values, bits)) {
      const said = `column ${name} of block ${block.entry.key} has a value without meaning`;
      throw new CorruptFileError('GSB-0410', 0, said);
    }
    visit(block, name, values);
  }
}

async function columnOrNull(block, name) {
  try {
    return await block.column(name);
  } catch (error) {
    if (!(error instanceof UnsupportedError)) throw error;
    block.fetched.delete(name);
    return null;
  }
}

function checkPlaces(block, codes) {
  const { low, high, key } = block.entry;
  const positions = block.placed(codes);
  const least = [Infinity, Infinity, Infinity];
  const most = [-1, -1, -1];
  for (let i = 0; i < positions.length; i++) {
    least[i % 3] = Math.min(least[i % 3], positions[i]);
    most[i % 3] = Math.max(most[i % 3], positions[i]);
  }
  const { corner } = block;
  const { resolution } = block.file.head;
  if (corner.some((at, axis) => at + low[axis] !== least[axis] || at + high[axis] !== most[axis])) {
    throw new CorruptFileError('GSB-0501', 0, `block ${key} has other bounds than its voxels`);
  }
  if (most.some((place) => place >= Math.ceil(resolution / 2 ** block.level))) {
    throw new CorruptFileError('GSB-0502', 0, `block ${key} has a voxel outside its level`);
  }
}

function isMeaningful(name, values, bits) {
  if (name === 'mask') return values.every((mask) => mask >= 1 && mask <= 63);
  if (name === 'normal') return areCanonical(values, bits);
  return name !== 'weight' || !values.includes(0);
}
