# ruff: noqa
# fmt: off
# made from spec/stream.ksy, SHA-256 5e09db451020778e957f1f466c6d9d5263709def35d9098dd3452d8613726306
# This is a generated file! Please edit source .ksy file and use kaitai-struct-compiler to rebuild
# type: ignore

import kaitaistruct
from kaitaistruct import KaitaiStruct, KaitaiStream, BytesIO
from enum import IntEnum


if getattr(kaitaistruct, 'API_VERSION', (0, 9)) < (0, 11):
    raise Exception("Incompatible Kaitai Struct Python API: 0.11 or later is required, but you have %s" % (kaitaistruct.__version__))

class GstreamStream(KaitaiStruct):
    """Triangles in chunks that can be read, skipped and lost one by one.
    
    .. seealso::
       stream.md
    """

    class Codec(IntEnum):
        raw = 0
        lz4 = 1
        constant = 2

    class Domain(IntEnum):
        vertex = 0
        corner = 1
        triangle = 2
        chunk = 3

    class Dtype(IntEnum):
        u1 = 1
        u2 = 2
        u4 = 3
        f4 = 4
        f8 = 5

    class Filter(IntEnum):
        none = 0
        delta = 1
        ordered_delta = 2
        first_use = 3
        corner_delta = 4
        ordered_corner_delta = 5
        edges = 6
    def __init__(self, _io, _parent=None, _root=None):
        super(GstreamStream, self).__init__(_io)
        self._parent = _parent
        self._root = _root or self
        self._read()

    def _read(self):
        self.magic = self._io.read_bytes(12)
        if not self.magic == b"\x89\x47\x53\x54\x20\x31\x2E\x30\x0D\x0A\x1A\x0A":
            raise kaitaistruct.ValidationNotEqualError(b"\x89\x47\x53\x54\x20\x31\x2E\x30\x0D\x0A\x1A\x0A", self.magic, self._io, u"/seq/0")
        self.min_reader_version = self._io.read_u2le()
        self.writer_version = self._io.read_u2le()
        self.incompatible_features = self._io.read_u4le()
        self.read_only_features = self._io.read_u4le()
        self.ignorable_features = self._io.read_u4le()
        self.num_attributes = self._io.read_u2le()
        self.zero = self._io.read_bytes(2)
        if not self.zero == b"\x00\x00":
            raise kaitaistruct.ValidationNotEqualError(b"\x00\x00", self.zero, self._io, u"/seq/7")
        self.metadata_bytes = self._io.read_u4le()
        self.attributes = []
        for i in range(self.num_attributes):
            self.attributes.append(GstreamStream.Attribute(self._io, self, self._root))

        self.metadata = (self._io.read_bytes(self.metadata_bytes)).decode(u"UTF-8")
        self.crc = self._io.read_u4le()


    def _fetch_instances(self):
        pass
        for i in range(len(self.attributes)):
            pass
            self.attributes[i]._fetch_instances()

        _ = self.directory
        if hasattr(self, '_m_directory'):
            pass
            self._m_directory._fetch_instances()

        _ = self.tail
        if hasattr(self, '_m_tail'):
            pass
            self._m_tail._fetch_instances()


    class Attribute(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Attribute, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.id = self._io.read_u2le()
            self.dtype = KaitaiStream.resolve_enum(GstreamStream.Dtype, self._io.read_u1())
            self.components = self._io.read_u1()
            self.zero = self._io.read_bytes(4)
            if not self.zero == b"\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00", self.zero, self._io, u"/types/attribute/seq/3")
            self.name = (KaitaiStream.bytes_strip_right(self._io.read_bytes(24), 0)).decode(u"ASCII")


        def _fetch_instances(self):
            pass


    class Chunk(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Chunk, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.magic = self._io.read_bytes(4)
            if not self.magic == b"\x43\x48\x4E\x4B":
                raise kaitaistruct.ValidationNotEqualError(b"\x43\x48\x4E\x4B", self.magic, self._io, u"/types/chunk/seq/0")
            self.index_bytes = self._io.read_u2le()
            self.num_parts = self._io.read_u2le()
            self.triangles = self._io.read_u4le()
            self.vertices = self._io.read_u4le()
            self.source = self._io.read_u4le()
            self.payload_bytes = self._io.read_u4le()
            self.non_finite = self._io.read_u4le()
            self.degenerate = self._io.read_u4le()
            self.box = []
            for i in range(6):
                self.box.append(self._io.read_f8le())

            self.parts = []
            for i in range(self.num_parts):
                self.parts.append(GstreamStream.Part(self._io, self, self._root))

            self.crc = self._io.read_u4le()
            self.payload = []
            for i in range(self.num_parts):
                self.payload.append(self._io.read_bytes(self.parts[i].stored))



        def _fetch_instances(self):
            pass
            for i in range(len(self.box)):
                pass

            for i in range(len(self.parts)):
                pass
                self.parts[i]._fetch_instances()

            for i in range(len(self.payload)):
                pass



    class Directory(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Directory, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.magic = self._io.read_bytes(4)
            if not self.magic == b"\x47\x44\x49\x52":
                raise kaitaistruct.ValidationNotEqualError(b"\x47\x44\x49\x52", self.magic, self._io, u"/types/directory/seq/0")
            self.num_chunks = self._io.read_u4le()
            self.totals_bytes = self._io.read_u4le()
            self.zero = self._io.read_bytes(4)
            if not self.zero == b"\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00", self.zero, self._io, u"/types/directory/seq/3")
            self.rows = []
            for i in range(self.num_chunks):
                self.rows.append(GstreamStream.Row(self._io, self, self._root))

            self.totals = (self._io.read_bytes(self.totals_bytes)).decode(u"UTF-8")


        def _fetch_instances(self):
            pass
            for i in range(len(self.rows)):
                pass
                self.rows[i]._fetch_instances()



    class Part(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Part, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.attribute = self._io.read_u2le()
            self.domain = KaitaiStream.resolve_enum(GstreamStream.Domain, self._io.read_u1())
            self.filter = KaitaiStream.resolve_enum(GstreamStream.Filter, self._io.read_u1())
            self.codec = KaitaiStream.resolve_enum(GstreamStream.Codec, self._io.read_u1())
            self.zero = self._io.read_bytes(3)
            if not self.zero == b"\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00", self.zero, self._io, u"/types/part/seq/4")
            self.stored = self._io.read_u4le()
            self.raw = self._io.read_u4le()
            self.crc = self._io.read_u4le()


        def _fetch_instances(self):
            pass


    class Row(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Row, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.offset = self._io.read_u8le()
            self.length = self._io.read_u4le()
            self.triangles = self._io.read_u4le()
            self.vertices = self._io.read_u4le()
            self.source = self._io.read_u4le()
            self.box = []
            for i in range(6):
                self.box.append(self._io.read_f8le())



        def _fetch_instances(self):
            pass
            for i in range(len(self.box)):
                pass

            _ = self.chunk
            if hasattr(self, '_m_chunk'):
                pass
                self._m_chunk._fetch_instances()


        @property
        def chunk(self):
            if hasattr(self, '_m_chunk'):
                return self._m_chunk

            io = self._root._io
            _pos = io.pos()
            io.seek(self.offset)
            self._m_chunk = GstreamStream.Chunk(io, self, self._root)
            io.seek(_pos)
            return getattr(self, '_m_chunk', None)


    class Tail(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamStream.Tail, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.file_length = self._io.read_u8le()
            self.directory_offset = self._io.read_u8le()
            self.directory_length = self._io.read_u8le()
            self.directory_crc = self._io.read_u4le()
            self.header_crc = self._io.read_u4le()
            self.crc = self._io.read_u4le()
            self.magic = self._io.read_bytes(12)
            if not self.magic == b"\x89\x47\x53\x54\x20\x31\x2E\x30\x0D\x0A\x1A\x0A":
                raise kaitaistruct.ValidationNotEqualError(b"\x89\x47\x53\x54\x20\x31\x2E\x30\x0D\x0A\x1A\x0A", self.magic, self._io, u"/types/tail/seq/6")


        def _fetch_instances(self):
            pass


    @property
    def directory(self):
        if hasattr(self, '_m_directory'):
            return self._m_directory

        _pos = self._io.pos()
        self._io.seek(self.tail.directory_offset)
        self._m_directory = GstreamStream.Directory(self._io, self, self._root)
        self._io.seek(_pos)
        return getattr(self, '_m_directory', None)

    @property
    def tail(self):
        if hasattr(self, '_m_tail'):
            return self._m_tail

        _pos = self._io.pos()
        self._io.seek(self._io.size() - 48)
        self._m_tail = GstreamStream.Tail(self._io, self, self._root)
        self._io.seek(_pos)
        return getattr(self, '_m_tail', None)
