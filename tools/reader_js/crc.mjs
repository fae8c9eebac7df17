/** CRC-32 as in zlib, PNG and gzip: polynomial 0xEDB88320, reflected, inverted. */

const SLICES = 8; // bytes per step; Kounavis and Berry, "Slicing-by-8", 2005
const TABLE = new Int32Array(256 * SLICES);

for (let byte = 0; byte < 256; byte++) {
  let crc = byte;
  for (let bit = 0; bit < 8; bit++) crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  TABLE[byte] = crc;
}
for (let i = 256; i < 256 * SLICES; i++) {
  TABLE[i] = (TABLE[i - 256] >>> 8) ^ TABLE[TABLE[i - 256] & 255];
}

/**
 * @param {Uint8Array} data
 * @param {number} [before] CRC of the bytes before these
 * @returns {number} u32
 */
export function crc32(data, before = 0) {
  let crc = ~before;
  let at = 0;
  for (const last = data.length - SLICES; at <= last; at += SLICES) {
    crc ^= data[at] | (data[at + 1] << 8) | (data[at + 2] << 16) | (data[at + 3] << 24);
    crc =
      TABLE[1792 + (crc & 255)] ^
      TABLE[1536 + ((crc >>> 8) & 255)] ^
      TABLE[1280 + ((crc >>> 16) & 255)] ^
      TABLE[1024 + (crc >>> 24)] ^
      TABLE[768 + data[at + 4]] ^
      TABLE[512 + data[at + 5]] ^
      TABLE[256 + data[at + 6]] ^
      TABLE[data[at + 7]];
  }
  for (; at < data.length; at++) crc = (crc >>> 8) ^ TABLE[(crc ^ data[at]) & 255];
  return ~crc >>> 0;
}
