/** Undoing the filters of a geometry stream. Spec: spec/stream.md, sections 5.2 and 5.3. */

const FULL = 65536; // vertices of a full chunk, whose last mark a u16 cannot hold
const MISS = 255;
const EDGES = 16;

/**
 * Vertices of the corners from first-use codes.
 * @param {Uint8Array} planes low bytes, then high bytes
 * @param {number} vertices
 * @returns {Uint16Array | null} null when the codes are broken or leave vertices unused
 */
export function firstUse(planes, vertices) {
  const corners = new Uint16Array(planes.length / 2);
  let mark = 0;
  for (let i = 0; i < corners.length; i++) {
    const below = planes[i] | (planes[i + corners.length] << 8);
    const vertex = below === 0 && mark === FULL ? 0 : mark - below;
    if (vertex < 0 || vertex >= vertices) return null;
    if (vertex === mark) mark++;
    corners[i] = vertex;
  }
  return mark === vertices ? corners : null;
}

/**
 * Vertices of the corners from edge codes.
 * @param {Uint8Array} data a code per triangle, then low and high bytes of numbers
 * @param {number} triangles
 * @param {number} vertices
 * @returns {Uint16Array | null} null when the codes are broken or leave vertices unused
 */
export function edgeCodes(data, triangles, vertices) {
  const corners = new Uint16Array(3 * triangles);
  const numbers = (data.length - triangles) / 2;
  let edges = []; // the youngest first
  let mark = 0;
  let used = 0;
  const next = () => (mark < vertices ? mark++ : -1);
  const take = () => {
    if (used === numbers) return -1;
    const at = triangles + used++;
    const below = data[at] | (data[at + numbers] << 8);
    if (below !== 0) return mark - below;
    return mark === FULL ? 0 : next();
  };
  for (let t = 0; t < triangles; t++) {
    const code = data[t];
    const known = code !== MISS;
    const slot = Math.floor(code / 6);
    if (known && slot >= edges.length) return null;
    const [a, b] = known ? edges[slot] : [take(), take()];
    const c = known && code % 2 === 0 ? next() : take();
    for (const vertex of [a, b, c]) if (vertex < 0 || vertex >= vertices) return null;
    const first = known ? (code >> 1) % 3 : 0; // which corner a is
    corners[3 * t + first] = a;
    corners[3 * t + ((first + 1) % 3)] = b;
    corners[3 * t + ((first + 2) % 3)] = c;
    const young = known ? [[a, c], [c, b]] : [[a, c], [c, b], [b, a]];
    edges = [...young, ...edges].slice(0, EDGES);
  }
  return mark === vertices && used === numbers ? corners : null;
}

/**
 * The earlier vertex that each vertex's difference is to; -1 for none.
 * @param {Uint16Array} corners
 * @param {number} vertices
 */
export function cornerBases(corners, vertices) {
  const bases = new Int32Array(vertices).fill(-2);
  for (let i = 0; i < corners.length; i++) {
    const vertex = corners[i];
    if (bases[vertex] !== -2) continue;
    const first = i - (i % 3);
    let base = -1;
    for (let k = first; k < first + 3; k++) {
      if (corners[k] < vertex) base = Math.max(base, corners[k]);
    }
    bases[vertex] = base === -1 ? vertex - 1 : base;
  }
  for (let i = 0; i < vertices; i++) if (bases[i] === -2) bases[i] = i - 1;
  return bases;
}

/**
 * Values from byte planes of zigzag differences.
 * @param {Uint8Array} planes
 * @param {number} count of values
 * @param {number} components
 * @param {number} width bytes of a number: 1, 2, 4 or 8
 * @param {boolean} ordered the numbers are ordered integers of floats
 * @param {Int32Array | null} bases earlier rows; null: the row before
 * @returns {ArrayBuffer} components of a value side by side
 */
export function undoDeltas(planes, count, components, width, ordered, bases) {
  const buffer = new ArrayBuffer(count * components * width);
  const [out, ops] = ARITHMETIC[width](buffer);
  for (let c = 0; c < components; c++) {
    const first = c * width * count;
    for (let i = 0; i < count; i++) {
      const base = bases ? bases[i] : i - 1;
      const step = ops.step(planes, first + i, count);
      out[i * components + c] = ops.add(base < 0 ? ops.zero : out[base * components + c], step);
    }
  }
  if (ordered) for (let i = 0; i < out.length; i++) out[i] = ops.unordered(out[i]);
  return buffer;
}

/** Up to 4 bytes in numbers; typed arrays take results modulo 2^8w. */
function narrow(width) {
  return {
    zero: 0,
    step(planes, at, count) {
      let zigzag = 0;
      for (let q = width - 1; q >= 0; q--) zigzag = (zigzag << 8) | planes[at + q * count];
      return (zigzag >>> 1) ^ -(zigzag & 1);
    },
    add: (a, b) => (a + b) | 0,
    unordered: (code) => (code & 0x80000000 ? code ^ 0x80000000 : ~code),
  };
}

const WIDE = {
  zero: 0n,
  step(planes, at, count) {
    let zigzag = 0n;
    for (let q = 7; q >= 0; q--) zigzag = (zigzag << 8n) | BigInt(planes[at + q * count]);
    return (zigzag >> 1n) ^ -(zigzag & 1n);
  },
  add: (a, b) => a + b,
  unordered: (code) => (code >> 63n ? code ^ (1n << 63n) : ~code),
};

const ARITHMETIC = {
  1: (buffer) => [new Uint8Array(buffer), narrow(1)],
  2: (buffer) => [new Uint16Array(buffer), narrow(2)],
  4: (buffer) => [new Uint32Array(buffer), narrow(4)],
  8: (buffer) => [new BigUint64Array(buffer), WIDE],
};
