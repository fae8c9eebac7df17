# The block file for Kaitai Struct (https://kaitai.io): head, directory, stored columns, tail.
# blockfile.md is the specification; where the two differ, it is right. Columns are not decoded here.
meta:
  id: gstream_blockfile
  title: Block file of voxels, version 1
  file-extension: gsb
  license: Apache-2.0
  ks-version: 0.11
  endian: le
doc: |
  Voxels at many resolutions, cut into blocks that a renderer loads on demand.
doc-ref: blockfile.md
seq:
  - id: magic
    contents: [0x89, "GSB 1.0", 0x0d, 0x0a, 0x1a, 0x0a]
    doc: '[GSB-0101]'
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
  - id: head_bytes
    type: u4
  - id: file_bytes
    type: u8
  - id: content_id
    size: 16
  - id: resolution
    type: u4
    doc: voxels per axis of level 0
  - id: snap_bits
    type: u1
  - id: num_levels
    type: u1
  - id: block_log2
    type: u1
    doc: a block has 2^block_log2 voxels per axis
  - id: separability
    type: u1
    enum: separability
  - id: ties
    type: u1
    enum: ties
  - id: faces
    type: u1
    enum: faces
  - id: normals
    type: u1
    enum: normals
  - id: lod_weighting
    type: u1
    enum: lod_weighting
  - id: normal_bits
    type: u1
  - id: zero
    contents: [0, 0, 0]
    doc: '[GSB-0104]'
  - id: matrix
    type: f8
    repeat: expr
    repeat-expr: 12
    doc: index -> world, 3 x 4, row-major
  - id: box
    type: f8
    repeat: expr
    repeat-expr: 6
    doc: low x y z, high x y z of the source
  - id: num_blocks
    type: u8
  - id: opening_bytes
    type: u8
  - id: num_pages
    type: u4
  - id: depth
    type: u1
  - id: num_columns
    type: u1
  - id: num_sections
    type: u1
  - id: zero2
    contents: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    doc: '[GSB-0104]'
  - id: sections
    type: section
    repeat: expr
    repeat-expr: num_sections
    doc: LEVL, COLM, PAGE, META, then those behind the body
  - id: levels
    type: level
    repeat: expr
    repeat-expr: num_levels
    doc: section LEVL, level 0 first
  - id: columns
    type: column
    repeat: expr
    repeat-expr: num_columns
    doc: section COLM
  - id: pages
    type: page(depth == 2)
    repeat: expr
    repeat-expr: sections[2].length / 32
    doc: section PAGE; of table pages at depth 2
  - id: metadata
    type: str
    size: sections[3].length
    encoding: UTF-8
    doc: section META, a JSON object
  - id: crc
    type: u4
    doc: of all bytes before [GSB-0103]
instances:
  tail:
    pos: _io.size - 64
    type: tail
types:
  section:
    seq:
      - id: type
        type: str
        size: 4
        encoding: ASCII
      - id: flags
        type: u4
      - id: offset
        type: u8
      - id: length
        type: u8
      - id: crc
        type: u4
      - id: zero
        contents: [0, 0, 0, 0]
    instances:
      critical:
        value: (flags & 1) == 1
      body:
        io: _root._io
        pos: offset
        size: length
  level:
    seq:
      - id: blocks
        type: u8
      - id: voxels
        type: u8
      - id: first
        type: u8
        doc: index of its first entry in the directory
      - id: block_log2
        type: u1
      - id: zero
        contents: [0, 0, 0, 0, 0, 0, 0]
  column:
    seq:
      - id: id
        type: u2
        enum: column_id
      - id: components
        type: u1
      - id: bits
        type: u1
      - id: zero
        contents: [0, 0, 0, 0]
      - id: name
        type: str
        size: 24
        pad-right: 0
        encoding: UTF-8
  page:
    params:
      - id: is_table
        type: bool
        doc: whether it holds page records, and not entries
    seq:
      - id: level
        type: u1
      - id: zero
        contents: [0, 0, 0]
      - id: count
        type: u4
      - id: key
        type: u8
      - id: offset
        type: u8
      - id: length
        type: u4
      - id: crc
        type: u4
    instances:
      entries:
        io: _root._io
        pos: offset
        type: entry
        repeat: expr
        repeat-expr: count
        if: not is_table
      pages:
        io: _root._io
        pos: offset
        type: page(false)
        repeat: expr
        repeat-expr: count
        if: is_table
  entry:
    seq:
      - id: key
        type: u8
        doc: Morton code of the block among those of its level
      - id: count
        type: u4
        doc: voxels
      - id: level
        type: u1
      - id: state
        type: u1
        enum: state
      - id: children
        type: u1
      - id: flags
        type: u1
        valid: 0
      - id: low
        type: u1
        repeat: expr
        repeat-expr: 3
      - id: high
        type: u1
        repeat: expr
        repeat-expr: 3
      - id: zero
        contents: [0, 0]
      - id: records
        type: column_record
        repeat: expr
        repeat-expr: _root.num_columns
  column_record:
    seq:
      - id: offset
        type: u8
      - id: stored
        type: u4
      - id: raw
        type: u4
      - id: crc
        type: u4
      - id: constant
        type: u4
      - id: codec
        type: u1
        enum: codec
      - id: filter
        type: u1
        enum: filter
      - id: zero
        contents: [0, 0, 0, 0, 0, 0]
    instances:
      data:
        io: _root._io
        pos: offset
        size: stored
        doc: filtered and packed
  tail:
    seq:
      - id: magic
        contents: [0x89, "GSBTAIL", 0x0d, 0x0a, 0x1a, 0x0a]
        doc: '[GSB-0102]'
      - id: file_bytes
        type: u8
      - id: content_id
        size: 16
      - id: head_crc
        type: u4
      - id: zero
        contents: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
      - id: crc
        type: u4
        doc: of the 60 bytes before
enums:
  separability:
    1: conservative
    6: six
    26: twenty_six
  ties:
    0: one_sided
    1: closed
  faces:
    0: front
    1: both
  normals:
    0: geometric
    1: input
  lod_weighting:
    0: count
    1: area
  state:
    0: empty
    1: data
  column_id:
    1: occupancy
    2: mask
    3: normal
    4: colour
    5: weight
    6: label
    7: spread
    32: vertex
    33: triangle
  codec:
    0: raw
    1: lz4
    2: constant
  filter:
    0: none
    1: byte_planes
    2: bit_planes
    3: delta_bit_planes
    4: xor_bit_planes
    5: green_delta_bit_planes
