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
].map((row) => [...row].map((digit) => parseInt(digit, 16)));

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
      for (let i = 0; i < 4; i++) this.#mix(i, i + 4, i + 8, i + 12, s[2 * i], s[2 * i + 1]);
      for (let i = 0; i < 4; i++) {
        const [b, c, d] = [4 + ((i + 1) % 4), 8 + ((i + 2) % 4), 12 + ((i + 3) % 4)];
        this.#mix(i, b, c, d, s[8 + 2 * i], s[9 + 2 * i]);
      }
    }
    for (let i = 0; i < 16; i++) this.#h[i] ^= v[i] ^ v[i + 16];
  }

  #mix(a, b, c, d, x, y) {
    this.#add(a, b, x);
    this.#turn(d, a, 0);
    this.#add(c, d);
    this.#turn(b, c, 24);
    this.#add(a, b, y);
    this.#turn(d, a, 16);
    this.#add(c, d);
    this.#turn(b, c, 63);
  }

  /** v[a] += v[b] + m[word]. */
  #add(a, b, word) {
    const v = this.#v;
    const [low, high] = word === undefined ? [0, 0] : [this.#m[2 * word], this.#m[2 * word + 1]];
    const sum = v[2 * a] + v[2 * b] + low;
    v[2 * a + 1] += v[2 * b + 1] + high + Math.floor(sum / 2 ** 32);
    v[2 * a] = sum;
  }

  /** v[a] = (v[a] ^ v[b]) rotated right by 0 (32), 24, 16 or 63 bits. */
  #turn(a, b, bits) {
    const v = this.#v;
    const low = v[2 * a] ^ v[2 * b];
    const high = v[2 * a + 1] ^ v[2 * b + 1];
    const [from, to] = bits === 0 || bits === 63 ? [high, low] : [low, high];
    const by = bits === 63 ? 31 : bits;
    v[2 * a] = by ? (from >>> by) | (to << (32 - by)) : from;
    v[2 * a + 1] = by ? (to >>> by) | (from << (32 - by)) : to;
  }
}
