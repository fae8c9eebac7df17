/** The vectors of the spec, and a server of them that answers ranges and counts requests. */

import { readFileSync, readdirSync } from 'node:fs';
import { createServer } from 'node:http';

const VECTORS = new URL('../../../spec/vectors/', import.meta.url);

/**
 * @param {'good' | 'bad'} kind
 * @param {'gsb' | 'gst'} format
 */
export function vectors(kind, format) {
  return readdirSync(new URL(kind, VECTORS)).filter((name) => name.endsWith(`.${format}`));
}

/** @returns {Uint8Array} */
export function vector(kind, name) {
  return new Uint8Array(readFileSync(new URL(`${kind}/${name}`, VECTORS)));
}

/**
 * Serve bytes under one URL until the test ends.
 * @param {import('node:test').TestContext} context
 * @param {Uint8Array} data
 * @param {{ranges?: boolean, extra?: number}} [faults] ignore ranges; send that many bytes too many
 * @returns {Promise<{url: string, requests: string[], headers: object[], data: Uint8Array, tag: string}>}
 *   the ranges asked for, and all headers; data and tag may be changed
 */
export async function serve(context, data, { ranges = true, extra = 0 } = {}) {
  const served = { url: '', requests: [], headers: [], data, tag: '"1"' };
  const server = createServer((request, response) => {
    served.requests.push(request.headers.range);
    served.headers.push(request.headers);
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).map(Number);
    const size = served.data.length;
    if (!ranges) {
      response.writeHead(200).end(served.data);
    } else if (first >= size) {
      response.writeHead(416, { 'Content-Range': `bytes */${size}` }).end();
    } else {
      const part = served.data.subarray(first, last + 1);
      const range = `bytes ${first}-${first + part.length - 1}/${size}`;
      response.writeHead(206, { 'Content-Range': range, ETag: served.tag });
      response.end(Buffer.concat([part, Buffer.alloc(extra)]));
    }
  });
  await new Promise((listening) => server.listen(0, '127.0.0.1', listening));
  context.after(() => {
    server.closeAllConnections();
    server.close();
  });
  served.url = `http://127.0.0.1:${server.address().port}/scene.gsb`;
  return served;
}
