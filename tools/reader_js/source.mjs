/**
 * Where the bytes come from: a URL (ranges only), a local file in Node, or memory.
 *
 * A source is `{name, size, read(offset, length), close()}`. `read` resolves to at most `length` bytes,
 * fewer only at the file's end, and never holds more than that. `size` is undefined until it is known.
 *
 * @typedef {object} Source
 * @property {string} name for messages
 * @property {number | undefined} size bytes of the whole file
 * @property {(offset: number, length: number) => Promise<Uint8Array>} read
 * @property {() => Promise<void>} close
 */

import { UnsupportedError } from './errors.mjs';

/**
 * @param {string | URL | Uint8Array | Source} from URL, path (Node only), the file's bytes, a source
 * @returns {Promise<Source>}
 */
export async function sourceOf(from) {
  if (from instanceof Uint8Array) return new BytesSource(from);
  if (typeof from === 'object' && 'read' in from) return from;
  const text = String(from);
  if (/^https?:/i.test(text)) return new HttpSource(text);
  return await FileSource.open(from);
}

/** A file in memory. */
export class BytesSource {
  name = 'memory';

  /** @param {Uint8Array} data */
  constructor(data) {
    this.data = data;
    this.size = data.length;
  }

  async read(offset, length) {
    return this.data.subarray(offset, offset + length);
  }

  async close() {}
}

/** A local file, in Node. */
export class FileSource {
  static async open(path) {
    const { open } = await import('node:fs/promises');
    const handle = await open(path, 'r');
    return new FileSource(String(path), handle, (await handle.stat()).size);
  }

  constructor(name, handle, size) {
    this.name = name;
    this.handle = handle;
    this.size = size;
  }

  async read(offset, length) {
    const data = new Uint8Array(Math.max(0, Math.min(length, this.size - offset)));
    let got = 0;
    while (got < data.length) {
      const { bytesRead } = await this.handle.read(data, got, data.length - got, offset + got);
      if (bytesRead === 0) break;
      got += bytesRead;
    }
    return data.subarray(0, got);
  }

  async close() {
    await this.handle.close();
  }
}

/** A file behind a URL, by range requests; a file that changes in between is noticed. */
export class HttpSource {
  size = undefined;
  #tag = null;

  /** @param {string} url */
  constructor(url) {
    this.name = url;
  }

  async read(offset, length) {
    if (length === 0) return new Uint8Array(0);
    const headers = { Range: `bytes=${offset}-${offset + length - 1}` };
    const response = await fetch(this.name, { headers });
    if (response.status === 416) return new Uint8Array(0); // the file ends before `offset`
    if (response.status !== 206) {
      await response.body?.cancel();
      const said = response.ok ? 'ignores range requests' : `answered ${response.status}`;
      throw new UnsupportedError(`the server of ${this.name} ${said}`);
    }
    this.#learn(response.headers);
    return await this.#body(response, length);
  }

  /**
   * Length and entity tag, from the first answer; later ones must have the same. `If-Match` would tell as
   * much, but across origins it costs a preflight request, and fails where the server does not allow it.
   */
  #learn(headers) {
    const range = /^bytes \d+-\d+\/(\d+)$/.exec(headers.get('content-range') ?? '');
    const size = range ? Number(range[1]) : this.size;
    const tag = headers.get('etag') ?? this.#tag;
    if (size !== (this.size ?? size) || tag !== (this.#tag ?? tag)) {
      throw new UnsupportedError(`${this.name} changed: open it again`);
    }
    this.size = size;
    this.#tag = tag;
  }

  /** The body; memory grows with what arrives, not with what the header of the answer promises. */
  async #body(response, length) {
    const parts = [];
    let got = 0;
    for (const reader = response.body.getReader(); ; ) {
      const { done, value } = await reader.read();
      if (done) break;
      got += value.length;
      if (got > length) {
        await reader.cancel();
        throw new UnsupportedError(`the server of ${this.name} sends more than was asked for`);
      }
      parts.push(value);
    }
    const data = new Uint8Array(got);
    let at = 0;
    for (const part of parts) {
      data.set(part, at);
      at += part.length;
    }
    return data;
  }

  async close() {}
}
