# The geometry stream for Kaitai Struct (https://kaitai.io): header, directory, chunks, stored parts.
# stream.md is the specification; where the two differ, it is right. Parts are not decoded here.
meta:
  id: gstream_stream
  title: Geometry stream of triangles, version 1
  file-extension: gst
  license: Apache-2.0
  ks-version: 0.11
  endian: le
doc: |
  Triangles in chunks that can be read, skipped and lost one by one.
doc-ref: stream.md
seq:
  - id: magic
    contents: [0x89, "GST 1.0", 0x0d, 0x0a, 0x1a, 0x0a]
    doc: '[GST-0001]'
  - id: min_reader_version
    type: u2
  - id: writer_version
    type: u2
  - id: incompatible_features
    type: u4
  - id: read_only_features
    type: u4
  - id: ignorable_features
    type: u4
  - id: num_attributes
    type: u2
  - id: zero
    contents: [0, 0]
    doc: '[GST-0005]'
  - id: metadata_bytes
    type: u4
  - id: attributes
    type: attribute
    repeat: expr
    repeat-expr: num_attributes
  - id: metadata
    type: str
    size: metadata_bytes
    encoding: UTF-8
    doc: a JSON object
  - id: crc
    type: u4
    doc: of all bytes before [GST-0003]
instances:
  tail:
    pos: _io.size - 48
    type: tail
  directory:
    pos: tail.directory_offset
    type: directory
types:
  attribute:
    seq:
      - id: id
        type: u2
      - id: dtype
        type: u1
        enum: dtype
      - id: components
        type: u1
      - id: zero
        contents: [0, 0, 0, 0]
      - id: name
        type: str
        size: 24
        pad-right: 0
        encoding: ASCII
  directory:
    seq:
      - id: magic
        contents: GDIR
        doc: '[GST-0206]'
      - id: num_chunks
        type: u4
      - id: totals_bytes
        type: u4
      - id: zero
        contents: [0, 0, 0, 0]
      - id: rows
        type: row
        repeat: expr
        repeat-expr: num_chunks
      - id: totals
        type: str
        size: totals_bytes
        encoding: UTF-8
        doc: a JSON object
  row:
    seq:
      - id: offset
        type: u8
      - id: length
        type: u4
      - id: triangles
        type: u4
      - id: vertices
        type: u4
      - id: source
        type: u4
      - id: box
        type: f8
        repeat: expr
        repeat-expr: 6
        doc: low x y z, high x y z
    instances:
      chunk:
        io: _root._io
        pos: offset
        type: chunk
  chunk:
    seq:
      - id: magic
        contents: CHNK
        doc: '[GST-0101]'
      - id: index_bytes
        type: u2
      - id: num_parts
        type: u2
      - id: triangles
        type: u4
      - id: vertices
        type: u4
      - id: source
        type: u4
      - id: payload_bytes
        type: u4
      - id: non_finite
        type: u4
      - id: degenerate
        type: u4
      - id: box
        type: f8
        repeat: expr
        repeat-expr: 6
        doc: low x y z, high x y z of the vertices
      - id: parts
        type: part
        repeat: expr
        repeat-expr: num_parts
      - id: crc
        type: u4
        doc: of the head before it [GST-0103]
      - id: payload
        size: parts[_index].stored
        repeat: expr
        repeat-expr: num_parts
        doc: the stored bytes of each part, filtered and packed
  part:
    seq:
      - id: attribute
        type: u2
        doc: id of a descriptor; 0 for indices
      - id: domain
        type: u1
        enum: domain
      - id: filter
        type: u1
        enum: filter
      - id: codec
        type: u1
        enum: codec
      - id: zero
        contents: [0, 0, 0]
      - id: stored
        type: u4
      - id: raw
        type: u4
      - id: crc
        type: u4
        doc: of the stored bytes [GST-0111]
  tail:
    seq:
      - id: file_length
        type: u8
      - id: directory_offset
        type: u8
      - id: directory_length
        type: u8
      - id: directory_crc
        type: u4
      - id: header_crc
        type: u4
      - id: crc
        type: u4
        doc: of the 32 bytes before
      - id: magic
        contents: [0x89, "GST 1.0", 0x0d, 0x0a, 0x1a, 0x0a]
        doc: '[GST-0201]'
enums:
  dtype:
    1: u1
    2: u2
    3: u4
    4: f4
    5: f8
  domain:
    0: vertex
    1: corner
    2: triangle
    3: chunk
  codec:
    0: raw
    1: lz4
    2: constant
  filter:
    0: none
    1: delta
    2: ordered_delta
    3: first_use
    4: corner_delta
    5: ordered_corner_delta
    6: edges
