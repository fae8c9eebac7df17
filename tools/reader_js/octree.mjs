/** Occupancy: the octree of a block, breadth-first child masks. Spec: section 7.3. */

const BITS = Uint8Array.from({ length: 256 }, (_, mask) => {
  let bits = 0;
  for (let rest = mask; rest; rest &= rest - 1) bits++;
  return bits;
});

/**
 * Where each level of the tree ends in the masks, and behind them the number of leaves; null if the
 * masks are not exactly one tree of `blockLog2` levels.
 * @param {Uint8Array} masks
 * @param {number} blockLog2
 * @returns {number[] | null}
 */
export function treeLevels(masks, blockLog2) {
  const levels = [];
  let at = 0;
  let nodes = 1;
  for (let level = 0; level < blockLog2; level++) {
    const end = at + nodes;
    if (end > masks.length) return null;
    nodes = 0;
    for (; at < end; at++) {
      if (masks[at] === 0) return null;
      nodes += BITS[masks[at]];
    }
    levels.push(end);
  }
  return at === masks.length ? [...levels, nodes] : null;
}

/**
 * Local Morton codes of the voxels, ascending.
 * @param {Uint8Array} masks
 * @param {number[]} levels what treeLevels gave
 */
export function expandOctree(masks, levels) {
  const codes = new Uint32Array(levels.at(-1));
  let nodes = 1;
  for (let level = 0; level < levels.length - 1; level++) {
    // From the back: no level has fewer nodes than the one above, so each is read in time.
    let from = nodes - 1;
    let mask = levels[level] - 1;
    nodes = level + 2 < levels.length ? levels[level + 1] - levels[level] : levels[level + 1];
    for (let to = nodes - 1; from >= 0; from--, mask--) {
      const code = codes[from] << 3;
      for (let rest = masks[mask]; rest; to--) {
        const child = 31 - Math.clz32(rest);
        codes[to] = code | child;
        rest ^= 1 << child;
      }
    }
  }
  return codes;
}

/** x | y << 8 | z << 16 of the three lowest bits of x, y and z, for a Morton code below 2^9. */
const PLACES = Uint32Array.from({ length: 512 }, (_, code) => {
  let place = 0;
  for (let bit = 0; bit < 9; bit++) {
    place |= ((code >> bit) & 1) << (8 * (bit % 3) + Math.floor(bit / 3));
  }
  return place;
});

/**
 * Places in the block, packed as x | y << 8 | z << 16.
 * @param {Uint32Array} codes local Morton codes
 */
export function placesOf(codes) {
  const places = new Uint32Array(codes.length);
  for (let i = 0; i < codes.length; i++) {
    const code = codes[i];
    places[i] =
      PLACES[code & 511] | (PLACES[(code >> 9) & 511] << 3) | (PLACES[code >> 18] << 6);
  }
  return places;
}
