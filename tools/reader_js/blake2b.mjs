/** BLAKE2b (RFC 7693) without a key, for comparing decoded content. Words are pairs of u32, low first. */

const IV = new Uint32Array([
  0xf3bcc908, 0x6a09e667, 0x84caa73b, 0xbb67ae85, 0xfe94f82b, 0x3c6ef372, 0x5f1d36f1, 0xa54ff53a,
  0xade682d1, 0x510e527f, 0x2b3e6c1f, 0x9b05688c, 0xfb41bd6b, 0x1f83d9ab, 0x137e2179, 0x5be0cd19,
]);
const SIGMA = [
  '0123456789abcdef', 'ea489fd61c02b753',
  'b8c052fdae367194', '7931dcbe265a40f8',
  '905724afe1bc683d', '2c6a0b834d75fe19',
  'c51fed4a0763928b', 'db7ec13950f4862a',
  '6fe9b308c2d714a5', 'a2847615fb9e3cd0',
].map((row) => [...row].map((digit) => 2 * parseInt(digit, 16)));

export class Blake2b {
  #h = IV.slice();
  #v = new Uint32Array(32);
  #block = new Uint8Array(128);
  #m = new Uint32Array(this.#block.buffer);
  #used = 0; // bytes in the block
  #total = 0;

  /** @param {number} digestBytes */
  constructor(digestBytes) {
    this.digestBytes = digestBytes;
    this.#h[0] ^= 0x01010000 ^ digestBytes;
  }

  /** @param {Uint8Array} data */
  update(data) {
    for (let at = 0; at < data.length; ) {
      if (this.#used === 128) this.#compress(false);
      const part = data.subarray(at, at + 128 - this.#used);
      this.#block.set(part, this.#used);
      this.#used += part.length;
      at += part.length;
    }
    return this;
  }

  /** The digest in hex; nothing can be added afterwards. */
  hex() {
    this.#block.fill(0, this.#used);
    this.#compress(true);
    const bytes = new Uint8Array(this.#h.buffer, 0, this.digestBytes);
    return Array.from(bytes, (byte) => byte.toString(16).padStart(2, '0')).join('');
  }

  #compress(last) {
    this.#total += this.#used;
    this.#used = 0;
    const v = this.#v;
    const m = this.#m;
    v.set(this.#h);
    v.set(IV, 16);
    v[24] ^= this.#total;
    v[25] ^= this.#total / 2 ** 32;
    if (last) {
      v[28] = ~v[28];
      v[29] = ~v[29];
    }
    for (let round = 0; round < 12; round++) {
      const s = SIGMA[round % 10];
      mix(v, m, 0, 8, 16, 24, s[0], s[1]);
      mix(v, m, 2, 10, 18, 26, s[2], s[3]);
      mix(v, m, 4, 12, 20, 28, s[4], s[5]);
      mix(v, m, 6, 14, 22, 30, s[6], s[7]);
      mix(v, m, 0, 10, 20, 30, s[8], s[9]);
      mix(v, m, 2, 12, 22, 24, s[10], s[11]);
      mix(v, m, 4, 14, 16, 26, s[12], s[13]);
      mix(v, m, 6, 8, 18, 28, s[14], s[15]);
    }
    for (let i = 0; i < 16; i++) this.#h[i] ^= v[i] ^ v[i + 16];
  }
}

/** The function G: mixes four words of v, whose first halves stand at a, b, c, d, with two of m. */
function mix(v, m, a, b, c, d, x, y) {
  const first = v[a] + v[b] + m[x];
  v[a + 1] += v[b + 1] + m[x + 1] + carry(first);
  v[a] = first;
  const dl = v[d + 1] ^ v[a + 1]; // rotated by 32
  v[d + 1] = v[d] ^ v[a];
  v[d] = dl;
  const second = v[c] + v[d];
  v[c + 1] += v[d + 1] + carry(second);
  v[c] = second;
  turn(v, b, c, 24);
  const third = v[a] + v[b] + m[y];
  v[a + 1] += v[b + 1] + m[y + 1] + carry(third);
  v[a] = third;
  turn(v, d, a, 16);
  const fourth = v[c] + v[d];
  v[c + 1] += v[d + 1] + carry(fourth);
  v[c] = fourth;
  const bl = v[b] ^ v[c];
  const bh = v[b + 1] ^ v[c + 1];
  v[b] = (bh >>> 31) | (bl << 1); // rotated by 63
  v[b + 1] = (bl >>> 31) | (bh << 1);
}

/** What a sum of up to three u32 carries into the second half of a word. */
function carry(sum) {
  return (sum / 2 ** 32) | 0;
}

/** v[a] ^ v[b], rotated right by fewer than 32 bits. */
function turn(v, a, b, bits) {
  const low = v[a] ^ v[b];
  const high = v[a + 1] ^ v[b + 1];
  v[a] = (low >>> bits) | (high << (32 - bits));
  v[a + 1] = (high >>> bits) | (low << (32 - bits));
}
