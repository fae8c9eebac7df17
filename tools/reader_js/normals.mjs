/** Octahedral normals. Spec: section 8.3. */

/**
 * Unit vectors of octahedral codes; 0, 0, 0 for *no direction*.
 * @param {Uint16Array} codes x and y code of each voxel
 * @param {number} bits of each code
 * @returns {Float32Array} x, y, z of each voxel, in grid axes
 */
export function directions(codes, bits) {
  const h = 2 ** (bits - 1) - 1;
  const vectors = new Float32Array((codes.length / 2) * 3);
  for (let from = 0, to = 0; from < codes.length; from += 2, to += 3) {
    let x = codes[from] - h;
    let y = codes[from + 1] - h;
    if (x > h && y > h) continue; // no direction
    const z = h - Math.abs(x) - Math.abs(y);
    if (z < 0) {
      const folded = (h - Math.abs(y)) * (x < 0 ? -1 : 1);
      y = (h - Math.abs(x)) * (y < 0 ? -1 : 1);
      x = folded;
    }
    const scale = 1 / Math.sqrt(x * x + y * y + z * z);
    vectors[to] = x * scale;
    vectors[to + 1] = y * scale;
    vectors[to + 2] = z * scale;
  }
  return vectors;
}

/**
 * Whether all codes are ones that a file may hold: canonical, or *no direction*.
 * @param {Uint16Array} codes
 * @param {number} bits
 */
export function areCanonical(codes, bits) {
  const h = 2 ** (bits - 1) - 1;
  for (let i = 0; i < codes.length; i += 2) {
    const x = codes[i] - h;
    const y = codes[i + 1] - h;
    if (x === h + 1 && y === h + 1) continue;
    if (x > h || y > h) return false;
    if (Math.abs(x) === h && y < 0) return false;
    if (Math.abs(y) === h && x < 0) return false;
  }
  return true;
}
