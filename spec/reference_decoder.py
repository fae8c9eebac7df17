"""Reference decoder: refuses what a reader must notice, prints the digests of what it decodes."""
import json
import struct
import sys
from hashlib import blake2b
from zlib import crc32

import lz4.block
import numpy as np

PAGE = "level u1,zero 3u1,count <u4,key <u8,offset <u8,length <u4,crc <u4"
RECORD = "offset <u8,stored <u4,raw <u4,crc <u4,constant <u4,codec u1,filter u1,zero 6u1"
ENTRY = "key <u8,count <u4,level u1,state u1,children u1,flags u1,low 3u1,high 3u1,zero 2u1"
PAGE, RECORD, ENTRY = ([tuple(f.split()) for f in s.split(",")] for s in (PAGE, RECORD, ENTRY))
COLUMNS = {1: (1, 8, 1), 2: (1, 6, 1), 4: (4, 8, 1), 5: (1, 32, 4), 6: (1, 32, 4), 7: (1, 8, 1)}
ATTRIBUTES = {0: (2, 1, (1,), (0, 3, 6)), 1: (4, 3, (0,), (0, 2, 5)), 2: (8, 3, (0,), (0, 2, 5)),
              3: (4, 3, (0,), (0, 2, 5)), 4: (1, 4, (0, 2, 3), (0, 1, 4))}  # see chunk
def need(condition, rule):
    if not condition:
        raise ValueError(rule)
def sealed(data, end):  # the four bytes at `end` are the CRC of those before
    return data[end : end + 4] == crc32(data[:end]).to_bytes(4, "little")
def unpack(data, codec, size, rule):
    need(codec == 0 or size <= 255 * len(data) + 64, rule)
    data = lz4.block.decompress(data, uncompressed_size=size) if codec else data
    need(len(data) == size, rule)
    return np.frombuffer(data, "u1")
def joined(planes, step, width):  # numbers from their planes of bits (step 1) or of bytes (step 8)
    return sum(plane.astype(f"<u{width}") << step * i for i, plane in enumerate(planes))
def below(codes, masks):  # Morton codes of the children that child masks name
    every = codes[:, None] << 3 | np.arange(8, dtype=codes.dtype)
    return every[np.unpackbits(masks.astype("u1")[:, None], axis=1, bitorder="little").view(bool)]
def rows(data, table, begin, dtype, rule):  # what stands in the (table) pages of a page table
    parts = [np.empty(0, dtype)]
    for level, zero, count, key, at, length, crc in np.frombuffer(table, PAGE).tolist():
        parts.append(np.frombuffer(data[at : at + length], dtype))
        need(at >= begin and not any(zero) and len(parts[-1]) == count in range(1, 1025), rule)
        need(crc32(parts[-1]) == crc and parts[-1][["level", "key"]].item(0) == (level, key), rule)
    return np.concatenate(parts)
def blocks(data):  # (level, counts, {column: (components, n) values}) of each block with voxels
    end, length = int.from_bytes(data[28:32], "little") - 4, len(data).to_bytes(8, "little")
    need(461 <= end <= 65532 and sealed(data, end), "GSB-0103")
    need(data[12] <= 1 and not any(data[13:14] + data[16:20]), "unsupported")
    tail = b"\x89GSBTAIL\r\n\x1a\n" + length + data[40:56] + data[end : end + 4] + bytes(20)
    need(data[32:40] == length and data[-64:-4] == tail and sealed(data[-64:], 60), "GSB-0102")
    size, snap, levels, log2, kind, *codes, bits = struct.unpack_from("<I9B", data, 56)
    count, _, pages, depth, _, sections = struct.unpack_from("<QQIBBB", data, 216)
    need(0 < size <= 1 << 16 and 0 < levels < 18 and 3 <= log2 <= 8 <= bits <= 12, "GSB-0105")
    need(snap <= 16 and kind in (1, 6, 26) and max(codes) <= 1 and depth in (1, 2), "GSB-0105")
    table = [struct.unpack_from("<4sIQQ", data, 256 + 32 * i) for i in range(sections)]
    need([row[0] for row in table if row[1] & 1] == b"LEVL COLM PAGE META".split(), "unsupported")
    begin, data = end + 4, data[: -64 - sum(row[3] for row in table if row[1] & 1 == 0)]
    _, names, table, _ = (data[at : at + size] for _, critical, at, size in table if critical & 1)
    names = {i: name.rstrip(b"\0").decode() for i, name in struct.iter_unpack("<H6x24s", names)}
    table = rows(data, table, begin, PAGE, "GSB-0207") if depth == 2 else np.frombuffer(table, PAGE)
    entries = rows(data, table, begin, [*ENTRY, *((str(i), RECORD) for i in names)], "GSB-0301")
    need((len(table), len(entries)) == (pages, count) and count <= 1 << 24, "GSB-0206")
    key, at, mask = (entries[name].astype("i8") for name in ("key", "level", "children"))
    need((np.diff(key - (at << 48)) > 0).all(), "GSB-0303")
    need((at < np.where(mask, levels, 1)).all(), "GSB-0306")
    for n in range(levels):
        need(np.array_equal(below(key[at == n], mask[at == n]), key[at == n - 1]), "GSB-0306")
    shapes = COLUMNS | {3: (2, bits, 2), 32: (3, log2 + snap + 1, 4), 33: (3, 32, 4)}
    for row in entries[entries["state"] != 0]:
        need(1 <= row["count"] <= 8**log2, "GSB-0409")
        found = {"key": row["key"]} | {names[i]: column(data, row, i, log2, shapes) for i in names}
        yield int(row["level"]), {"blocks": 1, "voxels": int(row["count"])}, found
def column(data, entry, id_, log2, shapes):  # None: a kind, codec or filter that is unknown
    offset, stored, raw, crc, constant, codec, filter_, _ = entry[str(id_)].item()
    part = data[offset : offset + stored]
    need(len(part) == stored and crc32(part) == crc, "GSB-0411")
    if id_ not in shapes or codec > 2 or filter_ > 5:
        return None
    parts, bits, item = shapes[id_]  # components, bits, bytes
    n = int(entry["count"]) if id_ < 32 else raw // 12 * (codec < 2)
    need(filter_ == 0 or (codec < 2 and id_ > 1 and (filter_ < 5 or id_ == 4)), "GSB-0404")
    sizes = range(log2, log2 * n + 1) if id_ == 1 else [n * parts * item or codec // 2]
    need(raw in sizes, "GSB-0402")
    if codec == 2 and id_ > 1:
        value = [constant >> 8 * item * i & (1 << 8 * item) - 1 for i in range(parts)]
        need(max(value) >> (n and bits) == constant >> 8 * item * parts == stored == 0, "GSB-0403")
        return np.repeat(np.array(value, f"<u{item}")[:, None], n, axis=1)
    part = unpack(part, codec, raw if filter_ < 2 else parts * bits * -(-n // 8), "GSB-0401")
    if id_ == 1:
        values = np.zeros(1, np.uint32)
        for _ in range(log2):
            masks, part = part[: len(values)], part[len(values) :]
            need(len(masks) == len(values) and masks.all(), "GSB-0407")
            values = below(values, masks)
        need(len(part) == 0 and len(values) == n, "GSB-0408")
        return values
    if filter_ < 2:
        part = part.reshape((parts, item, n) if filter_ else (parts, n, item))
        values = joined(np.moveaxis(part, 2 - filter_, 0), 8, item)
    else:
        planes = part.reshape(parts, bits, -1).swapaxes(0, 1)
        values = joined((np.unpackbits(plane, 1, n, "little") for plane in planes), 1, item)
        values = np.cumsum(values >> 1 ^ -(values & 1), 1, values.dtype) if filter_ % 2 else values
        values = np.bitwise_xor.accumulate(values, 1) if filter_ == 4 else values
    need(filter_ > 1 or values.max() >> bits == 0, "GSB-0405")
    if filter_ == 5:
        values[:3] = values[1] + values[0], values[0].copy(), values[2] + values[0]
    need(id_ != 33 or values.max() < entry["32"]["raw"] // 12, "GSB-0413")
    return values & values.dtype.type((1 << bits) - 1)
def stream(data):  # (0, counts, {attribute: (components, n) values}) of each chunk
    version, _, incompatible, _, _, count, _, text = struct.unpack_from("<HHIIIHHI", data, 12)
    at = 36 + 32 * count + text
    need(version <= 1 and not incompatible, "unsupported")
    need(count <= 32 and text <= 1 << 20 and sealed(data, at), "GST-0003")
    length, end, size, *crcs, magic = struct.unpack("<QQQI4sI12s", data[-48:])
    need(magic == data[:12] and length == len(data) == end + size + 48, "GST-0201")
    need(crcs == [crc32(data[end:-48]), data[at : at + 4], crc32(data[-48:-16])], "GST-0202")
    magic, count, text, zero = struct.unpack_from("<4sIII", data, end)
    need((magic, zero, size) == (b"GDIR", 0, 16 + 72 * count + text), "GST-0206")
    need(count <= 1 << 24 and text <= 1 << 22, "GST-0212")
    for row in range(end + 16, end + 16 + 72 * count, 72):
        begin, at = at + 4, at + int.from_bytes(data[row + 8 : row + 12], "little")
        need(int.from_bytes(data[row : row + 8], "little") == begin and at + 4 <= end, "GST-0208")
        yield 0, *chunk(data[begin : at + 4], data[row + 12 : row + 72])
    need(at + 4 == end, "GST-0208")
def chunk(data, row):
    magic, width, parts, triangles, vertices, _, payload = struct.unpack_from("<4sHHIIII", data)
    at, found, stated = 84 + 20 * parts, {}, np.frombuffer(data[32:80])
    need(magic == b"CHNK" and parts <= 32 and sealed(data, at - 4), "GST-0103")
    records = list(struct.iter_unpack("<HBBB3xIII", data[80 : at - 4]))
    ids, *_, sizes, _, _ = zip(*records, strict=True)
    need(data[8:20] + data[32:80] == row and len(data) - at == payload == sum(sizes), "GST-0207")
    need(max(triangles, vertices) <= 65536 and np.isfinite(stated).all(), "GST-0104 or GST-0115")
    need(len(set(ids)) == parts and (1 in ids) != (2 in ids) and 0 not in ids[1:], "GST-0108")
    need(width == 2 * (0 in ids) and (width or vertices == 3 * triangles), "GST-0109")
    for id_, domain, filter_, codec, stored, raw, crc in records:
        part, at, found[id_] = data[at : at + stored], at + stored, None
        need(crc32(part) == crc and raw <= 1 << 26, "GST-0111")
        item, components, domains, filters = ATTRIBUTES.get(id_, (0, 0, (), ()))
        known = domain in domains and filter_ in filters and codec < 3
        if not known or (filter_ in (4, 5) and found.get(0, 0) is None):
            continue
        n = (vertices, 3 * triangles, triangles, 1)[domain]
        size = item * components * (n if codec < 2 else 1)
        size = raw if filter_ == 6 and raw - triangles in range(0, size + 1, 2) else size
        need(raw == size and (codec < 2 or filter_ == 0), "GST-0107")
        need(filter_ not in (4, 5) or (width and domain == 0), "GST-0107")
        part = unpack(part, codec == 1, size, "GST-0113")
        if filter_ == 0:
            values = np.resize(part.view(f"<u{item}"), (n, components))
        elif id_ == 0:
            values = connect(part, triangles if filter_ == 6 else 0, triangles, vertices)
        else:
            planes = part.reshape(components, item, n).transpose(1, 2, 0)
            values = undelta(planes, found[0] if filter_ > 3 else np.empty(0), filter_ in (2, 5))
        need(id_ or not n or values.max() < vertices, "GST-0112")
        if id_ in (1, 2):
            points = values.view(f"<f{item}") + 0.0 if n else np.zeros((1, 3))  # not -0.0
            need(struct.pack("<6d", *points.min(0), *points.max(0)) == data[32:80], "GST-0117")
        found[id_] = values.T
    return {"chunks": 1, "triangles": triangles, "vertices": vertices}, found
def connect(data, start, triangles, vertices):  # vertices of the corners; codes stand before start
    numbers = iter(joined(data[start:].reshape(2, -1), 8, 4).tolist())
    mark, edges, corners = 0, [], []
    for code in data[:start].tolist() or [255] * triangles:
        new = list(edges[code // 6]) if code < 255 else []
        while len(new) < 3:
            number = next(numbers, 1 << 17) if code % 2 else 0
            new.append(mark - number if number or mark < 65536 else 0)
            need(0 <= new[-1] < vertices and (code % 2 or mark < vertices), "GST-0114")
            mark += number == 0 and mark < vertices
        a, b, c = new
        corners += [(a, b, c), (c, a, b), (b, c, a)][code // 2 % 3 if code < 255 else 0]
        edges = ([(a, c), (c, b)] + [(b, a)] * (code == 255) + edges)[:16]
    need(mark == vertices and next(numbers, None) is None, "GST-0114")
    return np.array(corners, "<u2").reshape(-1, 1)
def undelta(planes, corners, ordered):  # values from their differences to earlier ones
    values = joined(planes, 8, len(planes))
    values = np.pad(values >> 1 ^ -(values & 1), ((0, 1), (0, 0)))  # a last row of zeros is row -1
    base, half = {}, values.dtype.type(1 << 8 * len(planes) - 1)
    for triangle in corners.reshape(-1, 3).tolist():
        for vertex in triangle:
            base.setdefault(vertex, max((v for v in triangle if v < vertex), default=vertex - 1))
    for i in range(len(values) - 1):
        values[i] += values[base.get(i, i - 1)]
    return np.where(values < half, ~values, values ^ half)[:-1] if ordered else values[:-1]
def read(data):  # what `blocks` or `stream` gives; a broken file raises ValueError, nothing else
    kinds = {b"\x89GSB 1.0\r\n\x1a\n": blocks, b"\x89GST 1.0\r\n\x1a\n": stream}
    try:
        yield from kinds[data[:12]](data)
    except (LookupError, struct.error, lz4.block.LZ4BlockError) as error:
        raise ValueError(f"malformed: {error}") from error
def summary(data):  # how much there is, with digests, of each level; a stream is one level
    levels = {}
    for number, counts, found in read(data):
        total, columns = levels.setdefault(number, ({"level": number}, {}))
        total |= {what: total.get(what, 0) + count for what, count in counts.items()}
        for name, values in found.items():
            columns[name] = None if values is None else columns.get(name, blake2b(digest_size=16))
            if columns[name]:  # and not None: all that came so far could be read
                columns[name].update(values.T.tobytes())
    return {"levels": [total | {"columns": c} for _, (total, c) in sorted(levels.items())]}
if __name__ == "__main__":
    print(json.dumps(summary(np.fromfile(sys.argv[1], "u1").tobytes()), default=blake2b.hexdigest))
