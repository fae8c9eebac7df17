/** The parts that other formats share: checksum, LZ4, Morton codes, hash; against frozen values. */

import assert from 'node:assert/strict';
import { test } from 'node:test';

import { Blake2b } from '../blake2b.mjs';
import { fromMorton, toMorton } from '../bytes.mjs';
import { crc32 } from '../crc.mjs';
import { parseObject } from '../json.mjs';
import { unpackLz4 } from '../lz4.mjs';

const text = (words) => new TextEncoder().encode(words);

test('the CRC is the one of zlib, whole or in two parts', () => {
  assert.equal(crc32(text('123456789')), 0xcbf43926);
  assert.equal(crc32(new Uint8Array(1000).fill(255)), 0xe0533230);
  assert.equal(crc32(text('456789'), crc32(text('123'))), 0xcbf43926);
});

test('BLAKE2b gives the digests of RFC 7693 and of hashlib', () => {
  const whole =
    'ba80a53f981c4d0d6a2797b69f12f6e94c212f14685ac4b74b12bb6fdbffa2d1' +
    '7d87c5392aab792dc252d5de4533cc9518d38aa8dbf1925ab92386edd4009923';
  assert.equal(new Blake2b(64).update(text('abc')).hex(), whole);
  assert.equal(new Blake2b(16).hex(), 'cae66941d9efbd404e4d88758ea67670');
  const parts = new Blake2b(16);
  for (let i = 0; i < 1000; i++) parts.update(new Uint8Array([i]));
  assert.equal(parts.hex(), '978a3f8b45508a42fe7f0f99caf2c423');
});

test('Morton codes of 48 bits go both ways', () => {
  assert.deepEqual(fromMorton(0b011110), [0b10, 0b11, 0b01]);
  assert.deepEqual(fromMorton(2 ** 48 - 1), [65535, 65535, 65535]);
  assert.equal(toMorton(65535, 0, 0), 0x249249249249);
  for (const place of [[1, 2, 3], [40000, 7, 65535], [255, 256, 257]]) {
    assert.deepEqual(fromMorton(toMorton(...place)), place);
  }
});

const BLOCK = [0x1f, 0x61, 1, 0, 0, 0x50, 0x62, 0x63, 0x64, 0x65, 0x66]; // a 20 times, then bcdef

test('an LZ4 block with an overlapping match unpacks', () => {
  const out = unpackLz4(new Uint8Array(BLOCK), 25);
  assert.equal(new TextDecoder().decode(out), 'a'.repeat(20) + 'bcdef');
});

test('an LZ4 block cut or extended anywhere, or of another length, is refused', () => {
  for (let end = 0; end < BLOCK.length; end++) {
    assert.equal(unpackLz4(new Uint8Array(BLOCK.slice(0, end)), 25), null);
  }
  assert.equal(unpackLz4(new Uint8Array([...BLOCK, 0]), 25), null);
  for (const length of [0, 1, 24, 26, 65536]) {
    assert.equal(unpackLz4(new Uint8Array(BLOCK), length), null);
  }
});

test('an LZ4 match that reaches back before the beginning is refused', () => {
  for (const back of [2, 255]) {
    assert.equal(unpackLz4(new Uint8Array(BLOCK.with(2, back)), 25), null);
  }
});

test('an LZ4 match that reaches back by nothing is of zeros', () => {
  const out = unpackLz4(new Uint8Array(BLOCK.with(2, 0)), 25);
  assert.equal(new TextDecoder().decode(out), 'a' + '\0'.repeat(19) + 'bcdef');
});

test('a JSON object is read', () => {
  const words = '{"a":[1,{"b":":\\"}"}],"__proto__":{"b":null},"c":"\\ud83d\\ude00"}';
  assert.equal(JSON.stringify(parseObject(text(words))), words.replace('\\ud83d\\ude00', '😀'));
  const deep = '{"a":' + '['.repeat(62) + ']'.repeat(62) + '}';
  assert.notEqual(parseObject(text(deep)), undefined);
});

for (const [what, words] of [
  ['an array', '[1]'],
  ['null', 'null'],
  ['a byte order mark', '\ufeff{}'],
  ['NaN', '{"a":NaN}'],
  ['a key twice', '{"a":1,"b":{"a":1,"a":2}}'],
  ['a key twice, written otherwise', '{"a":1,"\\u0061":1}'],
  ['a number beyond binary64', '{"a":[1e999]}'],
  ['half a surrogate pair', '{"a":"\\ud800"}'],
  ['half a surrogate pair in a key', '{"\\udc00":1}'],
  ['64 levels', '{"a":' + '['.repeat(64) + ']'.repeat(64) + '}'],
  ['a million levels', '{"a":' + '['.repeat(1e6) + ']'.repeat(1e6) + '}'],
]) {
  test(`JSON with ${what} is refused`, () => {
    assert.equal(parseObject(text(words)), undefined);
  });
}

test('JSON that is not UTF-8 is refused', () => {
  assert.equal(parseObject(new Uint8Array([0x7b, 0x22, 0xff, 0x22, 0x3a, 0x31, 0x7d])), undefined);
});
