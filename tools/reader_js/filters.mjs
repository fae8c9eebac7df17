/** Undoing the filters of a column. Spec: section 7.2. Typed arrays are little-endian everywhere. */

const BYTE_PLANES = 1;
const BIT_PLANES = 2;
const DELTA = 3;
const XOR = 4;
const GREEN_DELTA = 5;

export const FILTERS = 6;
export const ARRAYS = { 1: Uint8Array, 2: Uint16Array, 4: Uint32Array }; // by bytes of an item

const SPREAD = Uint32Array.from({ length: 16 }, (_, nibble) => {
  return (nibble & 1) | ((nibble & 2) << 7) | ((nibble & 4) << 14) | ((nibble & 8) << 21);
}); // bit i of a nibble -> lowest bit of byte i

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
 * @param {number} filter
 * @param {Uint8Array} data exactly filteredBytes(...) of them
 * @param {number} count of voxels
 * @param {import('./head.mjs').Column} column
 * @returns {Uint8Array | Uint16Array | Uint32Array} components of a voxel side by side
 */
export function undoFilter(filter, data, count, column) {
  const { components, itemBytes, bits } = column;
  // Columns of several components have 32 bits per voxel. One type of array for all columns keeps the
  // loops below as fast as their machine code can be.
  const packed = new Uint32Array(count);
  const groups = (count + 7) >> 3;
  const bytes = filter >= BIT_PLANES ? new Uint8Array(Math.ceil(bits / 8) * 8 * groups) : data;
  for (let c = 0; c < components; c++) {
    const shift = 8 * itemBytes * c;
    if (filter >= BIT_PLANES) {
      fromBitPlanes(data, c * bits * groups, groups, bits, bytes);
      join(bytes, 0, 1, 8 * groups, Math.ceil(bits / 8), filter, bits, packed, shift);
    } else {
      const first = c * itemBytes * count;
      const [step, plane] = filter === BYTE_PLANES ? [1, count] : [itemBytes, 1];
      join(bytes, first, step, plane, itemBytes, filter, bits, packed, shift);
    }
  }
  if (filter === GREEN_DELTA) addGreen(packed);
  if (components * itemBytes === 4) return new ARRAYS[itemBytes](packed.buffer);
  return new ARRAYS[itemBytes](packed);
}

/** Bytes out of bit planes: bits 8 q + k of all values, out of 8 planes, become row q of bytes. */
function fromBitPlanes(data, first, groups, bits, bytes) {
  const words = new Uint32Array(bytes.buffer);
  for (let low = 0, to = 0; low < bits; low += 8) {
    const end = Math.min(8, bits - low);
    for (let i = 0; i < groups; i++, to += 2) {
      let even = 0; // values 8 i to 8 i + 3
      let odd = 0; // values 8 i + 4 to 8 i + 7
      for (let k = 0, at = first + low * groups + i; k < end; k++, at += groups) {
        const byte = data[at];
        even |= SPREAD[byte & 15] << k;
        odd |= SPREAD[byte >> 4] << k;
      }
      words[to] = even;
      words[to + 1] = odd;
    }
  }
}

/** Join the bytes of each value, undo the differences, and or the result into `packed` at a bit. */
function join(bytes, first, step, plane, width, filter, bits, packed, shift) {
  const low = bits === 32 ? -1 : (1 << bits) - 1;
  const delta = filter === DELTA || filter === GREEN_DELTA;
  let value = 0;
  for (let i = 0, at = first; i < packed.length; i++, at += step) {
    let coded = bytes[at];
    if (width > 1) coded |= bytes[at + plane] << 8;
    if (width > 2) coded |= (bytes[at + 2 * plane] << 16) | (bytes[at + 3 * plane] << 24);
    if (delta) value = (value + ((coded >>> 1) ^ -(coded & 1))) & low;
    else if (filter === XOR) value ^= coded;
    else value = coded;
    packed[i] |= value << shift;
  }
}

/** G, R - G, B - G, A -> R, G, B, A, modulo 256 each. */
function addGreen(packed) {
  for (let i = 0; i < packed.length; i++) {
    const word = packed[i];
    const green = word & 255;
    const red = (word >> 8) + green;
    const blue = (word >> 16) + green;
    packed[i] = (word & 0xff000000) | ((blue & 255) << 16) | (green << 8) | (red & 255);
  }
}
