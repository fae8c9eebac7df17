/** Little-endian numbers out of bytes, and Morton codes. */

export const LIMIT = 2 ** 53; // above, a double is no longer exact; no file is that long

/**
 * A u64. From 2^53 on the value is rounded, but stays at or above 2^53, so that every check against a
 * real offset or count refuses it.
 * @param {DataView} view
 * @param {number} at
 */
export function u64(view, at) {
  return view.getUint32(at + 4, true) * 2 ** 32 + view.getUint32(at, true);
}

/** @param {Uint8Array} data */
export function viewOf(data) {
  return new DataView(data.buffer, data.byteOffset, data.byteLength);
}

/**
 * Whether bytes from `first` up to, but not including, `end` are all zero.
 * @param {Uint8Array} data
 * @param {number} first
 * @param {number} end
 */
export function zeros(data, first, end) {
  for (let i = first; i < end; i++) if (data[i] !== 0) return false;
  return true;
}

/** Every third bit of a number below 2^24, from bit 0. */
function everyThird(code) {
  let bits = code & 0x249249;
  bits = (bits | (bits >> 2)) & 0x0c30c3;
  bits = (bits | (bits >> 4)) & 0x00f00f;
  return (bits | (bits >> 8)) & 0xff;
}

/**
 * The x, y, z of a Morton code below 2^48.
 * @param {number} code
 * @returns {[number, number, number]}
 */
export function fromMorton(code) {
  const high = Math.floor(code / 2 ** 24);
  const low = code % 2 ** 24;
  return [0, 1, 2].map((axis) => (everyThird(high >> axis) << 8) | everyThird(low >> axis));
}

/**
 * The Morton code of x, y, z, each below 2^16.
 * @param {number} x
 * @param {number} y
 * @param {number} z
 */
export function toMorton(x, y, z) {
  let code = 0;
  for (let bit = 15; bit >= 0; bit--) {
    code = code * 8 + (((x >> bit) & 1) | (((y >> bit) & 1) << 1) | (((z >> bit) & 1) << 2));
  }
  return code;
}
