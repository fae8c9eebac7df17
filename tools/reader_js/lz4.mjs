/**
 * One raw LZ4 block: no frame, no stated size. The format is lz4_Block_format.md of the LZ4 library,
 * whose end conditions are checked too, so that a block is valid here exactly if it is there.
 */

const LAST_LITERALS = 5; // the last bytes of a block are literals
const MATCH_LIMIT = 12; // no match begins in the last bytes

/**
 * @param {Uint8Array} source
 * @param {number} length of what the block must unpack to; the caller has checked it for sanity
 * @returns {Uint8Array | null} null when the block is broken or of another length
 */
export function unpackLz4(source, length) {
  const out = new Uint8Array(length);
  const end = source.length;
  let from = 0;
  let to = 0;
  for (;;) {
    if (from >= end) return null;
    const token = source[from++];

    let literals = token >> 4;
    if (literals === 15) {
      for (let more = 255; more === 255; literals += more) {
        if (from >= end) return null;
        more = source[from++];
      }
    }
    if (literals > end - from || literals > length - to) return null;
    if (literals > 24) {
      out.set(source.subarray(from, from + literals), to);
      from += literals;
      to += literals;
    } else {
      for (const stop = from + literals; from < stop; ) out[to++] = source[from++];
    }
    if (from === end) return to === length ? out : null; // the last sequence has no match

    if (to > length - MATCH_LIMIT || end - from < 2) return null;
    const back = source[from] | (source[from + 1] << 8);
    from += 2;
    if (back > to) return null;
    let match = token & 15;
    if (match === 15) {
      for (let more = 255; more === 255; match += more) {
        if (from >= end) return null;
        more = source[from++];
      }
    }
    match += 4;
    if (match > length - LAST_LITERALS - to) return null;
    if (back === 0) {
      to += match; // zeros, as of the library, though its format calls an offset of 0 invalid
    } else if (back === 1) {
      out.fill(out[to - 1], to, to + match);
      to += match;
    } else if (match > 24 && back >= match) {
      out.copyWithin(to, to - back, to - back + match);
      to += match;
    } else {
      for (const stop = to + match; to < stop; to++) out[to] = out[to - back]; // may overlap
    }
  }
}
