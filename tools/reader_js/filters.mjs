/** Undoing the filters of a column. Spec: section 7.2. Typed arrays are little-endian everywhere. */

const BYTE_PLANES = 1;
const BIT_PLANES = 2;
const DELTA = 3;
const XOR = 4;
const GREEN_DELTA = 5;

export const FILTERS = 6;
export const ARRAYS = { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }; // by bytes of an item

/**
 * Length of a column after its filter, before the codec.
 * @param {number} filter
 * @param {number} count of voxels
 * @param {import('./head.mjs').Column} column
 */
export function filteredBytes(filter, count, column) {
  if (filter >= BIT_PLANES) return column.components * column.bits * ((count + 7) >> 3);
  return column.components * column.itemBytes * count;
}

/**
 * Whether bits behind the last value of a bit plane are set.
 * @param {Uint8Array} planes
 * @param {number} count
 */
export function hasPadding(planes, count) {
  if ((count & 7) === 0) return false;
  const stride = (count + 7) >> 3;
  for (let i = stride - 1; i < planes.length; i += stride) {
    if (planes[i] >> (count & 7)) return true;
  }
  return false;
}

/**
 * Each step is a loop of its own over arrays of one type, which machine code is made for: a single
 * loop that does all of it takes twice the time.
 * @param {number} filter
 * @param {Uint8Array} data exactly filteredBytes(...) of them
 * @param {number} count of voxels
 * @param {import('./head.mjs').Column} column
 * @returns {Uint8Array | Uint16Array | Uint32Array} components of a voxel side by side
 */
export function undoFilter(filter, data, count, column) {
  const { components, itemBytes, bits } = column;
  const groups = (count + 7) >> 3;
  const width = filter < BIT_PLANES || bits > 16 ? itemBytes : Math.ceil(bits / 8);
  const bytes = filter >= BIT_PLANES ? new Uint8Array(8 * groups * width) : data;
  // Voxel columns of several components have 32 bits per voxel; vertices and triangles have more.
  const isWide = components * itemBytes > 4;
  const packed = new Int32Array(isWide ? components * count : count);
  const values = components === 1 ? packed : new Int32Array(count);
  for (let c = 0; c < components; c++) {
    if (filter >= BIT_PLANES) {
      fromBitPlanes(data, c * bits * groups, groups, bits, new Int32Array(bytes.buffer));
      join(bytes, 0, 1, 8 * groups, width, values);
    } else {
      const [step, plane] = filter === BYTE_PLANES ? [1, count] : [width, 1];
      join(bytes, c * width * count, step, plane, width, values);
    }
    if (filter === DELTA || filter === GREEN_DELTA) sumDeltas(values, bits);
    if (filter === XOR) xorAll(values);
    if (isWide) spread(values, packed, components, c);
    else if (components > 1) pack(values, packed, 8 * itemBytes * c);
  }
  if (filter === GREEN_DELTA) addGreen(packed);
  return new ARRAYS[itemBytes](components * itemBytes < 4 ? packed : packed.buffer);
}

/**
 * Bytes out of bit planes: planes 8 q to 8 q + 7 give row q, one byte per value.
 * 8 x 8 bits are transposed in two words: Warren, Hacker's Delight, section 7-3.
 */
function fromBitPlanes(data, first, groups, bits, words) {
  for (let low = 0, to = 0; low < bits; low += 8) {
    const planes = bits - low;
    const begin = first + low * groups;
    for (let at = begin; at < begin + groups; at++, to += 2) {
      let x = data[at];
      let y = 0;
      if (planes > 1) x |= data[at + groups] << 8;
      if (planes > 2) x |= data[at + 2 * groups] << 16;
      if (planes > 3) x |= data[at + 3 * groups] << 24;
      if (planes > 4) y = data[at + 4 * groups];
      if (planes > 5) y |= data[at + 5 * groups] << 8;
      if (planes > 6) y |= data[at + 6 * groups] << 16;
      if (planes > 7) y |= data[at + 7 * groups] << 24;
      let swap = (x ^ (x >>> 7)) & 0x00aa00aa;
      x ^= swap ^ (swap << 7);
      swap = (y ^ (y >>> 7)) & 0x00aa00aa;
      y ^= swap ^ (swap << 7);
      swap = (x ^ (x >>> 14)) & 0x0000cccc;
      x ^= swap ^ (swap << 14);
      swap = (y ^ (y >>> 14)) & 0x0000cccc;
      y ^= swap ^ (swap << 14);
      words[to] = (x & 0x0f0f0f0f) | ((y << 4) & 0xf0f0f0f0);
      words[to + 1] = ((x >>> 4) & 0x0f0f0f0f) | (y & 0xf0f0f0f0);
    }
  }
}

/** Values of `width` bytes each: byte q of value i is at first + i * step + q * plane. */
function join(bytes, first, step, plane, width, values) {
  const { length } = values;
  if (width === 1) {
    for (let i = 0, at = first; i < length; i++, at += step) values[i] = bytes[at];
  } else if (width === 2) {
    for (let i = 0, at = first; i < length; i++, at += step) {
      values[i] = bytes[at] | (bytes[at + plane] << 8);
    }
  } else {
    for (let i = 0, at = first; i < length; i++, at += step) {
      const low = bytes[at] | (bytes[at + plane] << 8);
      values[i] = low | (bytes[at + 2 * plane] << 16) | (bytes[at + 3 * plane] << 24);
    }
  }
}

function sumDeltas(values, bits) {
  const low = bits === 32 ? -1 : (1 << bits) - 1;
  const { length } = values;
  let value = 0;
  for (let i = 0; i < length; i++) {
    const coded = values[i];
    value = (value + ((coded >>> 1) ^ -(coded & 1))) & low;
    values[i] = value;
  }
}

function xorAll(values) {
  const { length } = values;
  let value = 0;
  for (let i = 0; i < length; i++) {
    value ^= values[i];
    values[i] = value;
  }
}

function spread(values, packed, step, first) {
  const { length } = values;
  for (let i = 0, to = first; i < length; i++, to += step) packed[to] = values[i];
}

function pack(values, packed, shift) {
  const { length } = values;
  for (let i = 0; i < length; i++) packed[i] |= values[i] << shift;
}

/** G, R - G, B - G, A -> R, G, B, A, modulo 256 each. */
function addGreen(packed) {
  const { length } = packed;
  for (let i = 0; i < length; i++) {
    const word = packed[i];
    const green = word & 255;
    const red = (word >> 8) + green;
    const blue = (word >> 16) + green;
    packed[i] = (word & 0xff000000) | ((blue & 255) << 16) | (green << 8) | (red & 255);
  }
}
