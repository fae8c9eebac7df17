/** JSON texts that all readers understand alike. */

const MAX_DEPTH = 64; // objects and arrays in each other

/**
 * The object that a UTF-8 JSON text is; undefined for anything else, and for what readers disagree
 * about: a key that stands twice, a number beyond binary64, half a surrogate pair, deeper nesting.
 * @param {Uint8Array} bytes
 * @returns {Record<string, any> | undefined}
 */
export function parseObject(bytes) {
  let text;
  let value;
  try {
    text = new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(bytes);
    value = JSON.parse(text);
  } catch {
    return undefined;
  }
  if (!isObject(value)) return undefined;
  let keys = 0;
  let nodes = [value];
  for (let depth = 0; nodes.length > 0; depth++) {
    if (depth >= MAX_DEPTH || !nodes.every(isLawful)) return undefined;
    const objects = nodes.filter(isObject);
    const names = objects.flatMap(Object.keys);
    if (!names.every(isLawful)) return undefined;
    keys += names.length;
    nodes = nodes.flatMap((node) => (isNested(node) ? Object.values(node) : []));
  }
  const colons = text.replace(/"(?:[^"\\]|\\.)*"/g, '').split(':').length - 1; // one for each key
  return colons === keys ? value : undefined;
}

/** @param {any} value */
export function isObject(value) {
  return isNested(value) && !Array.isArray(value);
}

function isNested(value) {
  return typeof value === 'object' && value !== null;
}

function isLawful(value) {
  if (typeof value === 'number') return Number.isFinite(value);
  return typeof value !== 'string' || !/\p{Surrogate}/u.test(value);
}
