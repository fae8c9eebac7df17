# ruff: noqa
# fmt: off
# made from spec/blockfile.ksy, SHA-256 909c9968c2e107d86c3815998700703e966fb3019fd7ea7ebfa537fe68f95e7a
# This is a generated file! Please edit source .ksy file and use kaitai-struct-compiler to rebuild
# type: ignore

import kaitaistruct
from kaitaistruct import KaitaiStruct, KaitaiStream, BytesIO
from enum import IntEnum


if getattr(kaitaistruct, 'API_VERSION', (0, 9)) < (0, 11):
    raise Exception("Incompatible Kaitai Struct Python API: 0.11 or later is required, but you have %s" % (kaitaistruct.__version__))

class GstreamBlockfile(KaitaiStruct):
    """Voxels at many resolutions, cut into blocks that a renderer loads on demand.
    
    .. seealso::
       blockfile.md
    """

    class Codec(IntEnum):
        raw = 0
        lz4 = 1
        constant = 2

    class ColumnId(IntEnum):
        occupancy = 1
        mask = 2
        normal = 3
        colour = 4
        weight = 5
        label = 6
        spread = 7
        vertex = 32
        triangle = 33

    class Faces(IntEnum):
        front = 0
        both = 1

    class Filter(IntEnum):
        none = 0
        byte_planes = 1
        bit_planes = 2
        delta_bit_planes = 3
        xor_bit_planes = 4
        green_delta_bit_planes = 5

    class LodWeighting(IntEnum):
        count = 0
        area = 1

    class Normals(IntEnum):
        geometric = 0
        input = 1

    class Separability(IntEnum):
        conservative = 1
        six = 6
        twenty_six = 26

    class State(IntEnum):
        empty = 0
        data = 1

    class Ties(IntEnum):
        one_sided = 0
        closed = 1
    def __init__(self, _io, _parent=None, _root=None):
        super(GstreamBlockfile, self).__init__(_io)
        self._parent = _parent
        self._root = _root or self
        self._read()

    def _read(self):
        self.magic = self._io.read_bytes(12)
        if not self.magic == b"\x89\x47\x53\x42\x20\x31\x2E\x30\x0D\x0A\x1A\x0A":
            raise kaitaistruct.ValidationNotEqualError(b"\x89\x47\x53\x42\x20\x31\x2E\x30\x0D\x0A\x1A\x0A", self.magic, self._io, u"/seq/0")
        self.min_reader_version = self._io.read_u2le()
        self.writer_version = self._io.read_u2le()
        self.incompatible_features = self._io.read_u4le()
        self.read_only_features = self._io.read_u4le()
        self.ignorable_features = self._io.read_u4le()
        self.head_bytes = self._io.read_u4le()
        self.file_bytes = self._io.read_u8le()
        self.content_id = self._io.read_bytes(16)
        self.resolution = self._io.read_u4le()
        self.snap_bits = self._io.read_u1()
        self.num_levels = self._io.read_u1()
        self.block_log2 = self._io.read_u1()
        self.separability = KaitaiStream.resolve_enum(GstreamBlockfile.Separability, self._io.read_u1())
        self.ties = KaitaiStream.resolve_enum(GstreamBlockfile.Ties, self._io.read_u1())
        self.faces = KaitaiStream.resolve_enum(GstreamBlockfile.Faces, self._io.read_u1())
        self.normals = KaitaiStream.resolve_enum(GstreamBlockfile.Normals, self._io.read_u1())
        self.lod_weighting = KaitaiStream.resolve_enum(GstreamBlockfile.LodWeighting, self._io.read_u1())
        self.normal_bits = self._io.read_u1()
        self.zero = self._io.read_bytes(3)
        if not self.zero == b"\x00\x00\x00":
            raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00", self.zero, self._io, u"/seq/19")
        self.matrix = []
        for i in range(12):
            self.matrix.append(self._io.read_f8le())

        self.box = []
        for i in range(6):
            self.box.append(self._io.read_f8le())

        self.num_blocks = self._io.read_u8le()
        self.opening_bytes = self._io.read_u8le()
        self.num_pages = self._io.read_u4le()
        self.depth = self._io.read_u1()
        self.num_columns = self._io.read_u1()
        self.num_sections = self._io.read_u1()
        self.zero2 = self._io.read_bytes(17)
        if not self.zero2 == b"\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00":
            raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00", self.zero2, self._io, u"/seq/28")
        self.sections = []
        for i in range(self.num_sections):
            self.sections.append(GstreamBlockfile.Section(self._io, self, self._root))

        self.levels = []
        for i in range(self.num_levels):
            self.levels.append(GstreamBlockfile.Level(self._io, self, self._root))

        self.columns = []
        for i in range(self.num_columns):
            self.columns.append(GstreamBlockfile.Column(self._io, self, self._root))

        self.pages = []
        for i in range(self.sections[2].length // 32):
            self.pages.append(GstreamBlockfile.Page(self.depth == 2, self._io, self, self._root))

        self.metadata = (self._io.read_bytes(self.sections[3].length)).decode(u"UTF-8")
        self.crc = self._io.read_u4le()


    def _fetch_instances(self):
        pass
        for i in range(len(self.matrix)):
            pass

        for i in range(len(self.box)):
            pass

        for i in range(len(self.sections)):
            pass
            self.sections[i]._fetch_instances()

        for i in range(len(self.levels)):
            pass
            self.levels[i]._fetch_instances()

        for i in range(len(self.columns)):
            pass
            self.columns[i]._fetch_instances()

        for i in range(len(self.pages)):
            pass
            self.pages[i]._fetch_instances()

        _ = self.tail
        if hasattr(self, '_m_tail'):
            pass
            self._m_tail._fetch_instances()


    class Column(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Column, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.id = KaitaiStream.resolve_enum(GstreamBlockfile.ColumnId, self._io.read_u2le())
            self.components = self._io.read_u1()
            self.bits = self._io.read_u1()
            self.zero = self._io.read_bytes(4)
            if not self.zero == b"\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00", self.zero, self._io, u"/types/column/seq/3")
            self.name = (KaitaiStream.bytes_strip_right(self._io.read_bytes(24), 0)).decode(u"UTF-8")


        def _fetch_instances(self):
            pass


    class ColumnRecord(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.ColumnRecord, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.offset = self._io.read_u8le()
            self.stored = self._io.read_u4le()
            self.raw = self._io.read_u4le()
            self.crc = self._io.read_u4le()
            self.constant = self._io.read_u4le()
            self.codec = KaitaiStream.resolve_enum(GstreamBlockfile.Codec, self._io.read_u1())
            self.filter = KaitaiStream.resolve_enum(GstreamBlockfile.Filter, self._io.read_u1())
            self.zero = self._io.read_bytes(6)
            if not self.zero == b"\x00\x00\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00\x00\x00", self.zero, self._io, u"/types/column_record/seq/7")


        def _fetch_instances(self):
            pass
            _ = self.data
            if hasattr(self, '_m_data'):
                pass


        @property
        def data(self):
            """filtered and packed."""
            if hasattr(self, '_m_data'):
                return self._m_data

            io = self._root._io
            _pos = io.pos()
            io.seek(self.offset)
            self._m_data = io.read_bytes(self.stored)
            io.seek(_pos)
            return getattr(self, '_m_data', None)


    class Entry(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Entry, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.key = self._io.read_u8le()
            self.count = self._io.read_u4le()
            self.level = self._io.read_u1()
            self.state = KaitaiStream.resolve_enum(GstreamBlockfile.State, self._io.read_u1())
            self.children = self._io.read_u1()
            self.flags = self._io.read_u1()
            if not self.flags == 0:
                raise kaitaistruct.ValidationNotEqualError(0, self.flags, self._io, u"/types/entry/seq/5")
            self.low = []
            for i in range(3):
                self.low.append(self._io.read_u1())

            self.high = []
            for i in range(3):
                self.high.append(self._io.read_u1())

            self.zero = self._io.read_bytes(2)
            if not self.zero == b"\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00", self.zero, self._io, u"/types/entry/seq/8")
            self.records = []
            for i in range(self._root.num_columns):
                self.records.append(GstreamBlockfile.ColumnRecord(self._io, self, self._root))



        def _fetch_instances(self):
            pass
            for i in range(len(self.low)):
                pass

            for i in range(len(self.high)):
                pass

            for i in range(len(self.records)):
                pass
                self.records[i]._fetch_instances()



    class Level(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Level, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.blocks = self._io.read_u8le()
            self.voxels = self._io.read_u8le()
            self.first = self._io.read_u8le()
            self.block_log2 = self._io.read_u1()
            self.zero = self._io.read_bytes(7)
            if not self.zero == b"\x00\x00\x00\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00\x00\x00\x00", self.zero, self._io, u"/types/level/seq/4")


        def _fetch_instances(self):
            pass


    class Page(KaitaiStruct):
        def __init__(self, is_table, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Page, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self.is_table = is_table
            self._read()

        def _read(self):
            self.level = self._io.read_u1()
            self.zero = self._io.read_bytes(3)
            if not self.zero == b"\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00", self.zero, self._io, u"/types/page/seq/1")
            self.count = self._io.read_u4le()
            self.key = self._io.read_u8le()
            self.offset = self._io.read_u8le()
            self.length = self._io.read_u4le()
            self.crc = self._io.read_u4le()


        def _fetch_instances(self):
            pass
            _ = self.entries
            if hasattr(self, '_m_entries'):
                pass
                for i in range(len(self._m_entries)):
                    pass
                    self._m_entries[i]._fetch_instances()


            _ = self.pages
            if hasattr(self, '_m_pages'):
                pass
                for i in range(len(self._m_pages)):
                    pass
                    self._m_pages[i]._fetch_instances()



        @property
        def entries(self):
            if hasattr(self, '_m_entries'):
                return self._m_entries

            if (not (self.is_table)):
                pass
                io = self._root._io
                _pos = io.pos()
                io.seek(self.offset)
                self._m_entries = []
                for i in range(self.count):
                    self._m_entries.append(GstreamBlockfile.Entry(io, self, self._root))

                io.seek(_pos)

            return getattr(self, '_m_entries', None)

        @property
        def pages(self):
            if hasattr(self, '_m_pages'):
                return self._m_pages

            if self.is_table:
                pass
                io = self._root._io
                _pos = io.pos()
                io.seek(self.offset)
                self._m_pages = []
                for i in range(self.count):
                    self._m_pages.append(GstreamBlockfile.Page(False, io, self, self._root))

                io.seek(_pos)

            return getattr(self, '_m_pages', None)


    class Section(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Section, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.type = (self._io.read_bytes(4)).decode(u"ASCII")
            self.flags = self._io.read_u4le()
            self.offset = self._io.read_u8le()
            self.length = self._io.read_u8le()
            self.crc = self._io.read_u4le()
            self.zero = self._io.read_bytes(4)
            if not self.zero == b"\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00", self.zero, self._io, u"/types/section/seq/5")


        def _fetch_instances(self):
            pass
            _ = self.body
            if hasattr(self, '_m_body'):
                pass


        @property
        def body(self):
            if hasattr(self, '_m_body'):
                return self._m_body

            io = self._root._io
            _pos = io.pos()
            io.seek(self.offset)
            self._m_body = io.read_bytes(self.length)
            io.seek(_pos)
            return getattr(self, '_m_body', None)

        @property
        def critical(self):
            if hasattr(self, '_m_critical'):
                return self._m_critical

            self._m_critical = self.flags & 1 == 1
            return getattr(self, '_m_critical', None)


    class Tail(KaitaiStruct):
        def __init__(self, _io, _parent=None, _root=None):
            super(GstreamBlockfile.Tail, self).__init__(_io)
            self._parent = _parent
            self._root = _root
            self._read()

        def _read(self):
            self.magic = self._io.read_bytes(12)
            if not self.magic == b"\x89\x47\x53\x42\x54\x41\x49\x4C\x0D\x0A\x1A\x0A":
                raise kaitaistruct.ValidationNotEqualError(b"\x89\x47\x53\x42\x54\x41\x49\x4C\x0D\x0A\x1A\x0A", self.magic, self._io, u"/types/tail/seq/0")
            self.file_bytes = self._io.read_u8le()
            self.content_id = self._io.read_bytes(16)
            self.head_crc = self._io.read_u4le()
            self.zero = self._io.read_bytes(20)
            if not self.zero == b"\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00":
                raise kaitaistruct.ValidationNotEqualError(b"\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00", self.zero, self._io, u"/types/tail/seq/4")
            self.crc = self._io.read_u4le()


        def _fetch_instances(self):
            pass


    @property
    def tail(self):
        if hasattr(self, '_m_tail'):
            return self._m_tail

        _pos = self._io.pos()
        self._io.seek(self._io.size() - 64)
        self._m_tail = GstreamBlockfile.Tail(self._io, self, self._root)
        self._io.seek(_pos)
        return getattr(self, '_m_tail', None)
