# SPDX-License-Identifier: Apache-2.0
"""Writes Parquet files: one row group, one plain page a column, not compressed, no empty cells.

That is all that holdfast.lerobot needs, and every reader reads it; Debian 12 has no library for Parquet.
"""

import struct

_MAGIC = b"PAR1"
_KINDS = {"float32": (4, "f"), "int64": (2, "q")}  # Parquet's number of the type; struct's letter
_PLAIN, _RLE, _REQUIRED, _REPEATED, _LIST = 0, 3, 0, 2, 3


def _varint(value):
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(out) + bytes([value])


class _Struct:
    """A struct in Thrift's compact protocol; fields in the order of their numbers."""

    def __init__(self):
        self.bytes = bytearray()
        self.last = 0

    def _field(self, number, kind):
        self.bytes.append((number - self.last) << 4 | kind)
        self.last = number

    def number(self, number, value, kind):
        self._field(number, kind)
        self.bytes += _varint(value << 1)  # zigzag; nothing here is negative
        return self

    def i32(self, number, value):
        return self.number(number, value, 5)

    def i64(self, number, value):
        return self.number(number, value, 6)

    def text(self, number, value):
        self._field(number, 8)
        self.bytes += _text(value)
        return self

    def many(self, number, kind, encoded):
        self._field(number, 9)
        short = len(encoded) < 15
        self.bytes += bytes([len(encoded) << 4 | kind]) if short else bytes([0xF0 | kind]) + _varint(len(encoded))
        self.bytes += b"".join(encoded)
        return self

    def struct(self, number, value):
        self._field(number, 12)
        self.bytes += value
        return self

    def end(self):
        return bytes(self.bytes) + b"\0"


def _text(value):
    encoded = value.encode("utf-8")
    return _varint(len(encoded)) + encoded


def _levels(runs):
    """Definition or repetition levels of one bit: (count, level) runs, behind their size."""
    encoded = b"".join(_varint(count << 1) + bytes([level]) for count, level in runs)
    return struct.pack("<I", len(encoded)) + encoded


def write(path, columns):
    """columns: (name, "float32" or "int64", values); values are numbers, or lists of one length above 1."""
    rows = {len(values) for _, _, values in columns}
    if len(rows) != 1:
        raise ValueError(f"columns of {sorted(rows)} rows")
    (rows,) = rows
    schema, chunks, out = [], [], bytearray(_MAGIC)
    for name, kind, values in columns:
        number, letter = _KINDS[kind]
        width = len(values[0]) if values and hasattr(values[0], "__len__") else 0
        path_in_schema, levels, flat = [name], b"", values
        if width:
            if width < 2 or any(len(value) != width for value in values):
                raise ValueError(f"{name}: lists of several lengths, or of one")
            path_in_schema = [name, "list", "element"]
            flat = [cell for value in values for cell in value]
            # The first cell of a row begins a list, the others go on with it; all are there.
            levels = _levels([(1, 0), (width - 1, 1)] * rows) + _levels([(len(flat), 1)])
            schema.append(_Struct().i32(3, _REQUIRED).text(4, name).i32(5, 1).i32(6, _LIST).end())
            schema.append(_Struct().i32(3, _REPEATED).text(4, "list").i32(5, 1).end())
        schema.append(_Struct().i32(1, number).i32(3, _REQUIRED).text(4, path_in_schema[-1]).end())
        page = levels + struct.pack(f"<{len(flat)}{letter}", *flat)
        data = _Struct().i32(1, len(flat)).i32(2, _PLAIN).i32(3, _RLE).i32(4, _RLE).end()
        header = _Struct().i32(1, 0).i32(2, len(page)).i32(3, len(page)).struct(5, data).end()
        size = len(header) + len(page)
        meta = _Struct().i32(1, number).many(2, 5, [_varint(_PLAIN << 1), _varint(_RLE << 1)])
        meta.many(3, 8, [_text(part) for part in path_in_schema]).i32(4, 0).i64(5, len(flat))
        meta.i64(6, size).i64(7, size).i64(9, len(out))
        chunks.append((size, _Struct().i64(2, len(out)).struct(3, meta.end()).end()))
        out += header + page
    root = _Struct().text(4, "schema").i32(5, len(columns)).end()
    group = _Struct().many(1, 12, [chunk for _, chunk in chunks]).i64(2, sum(size for size, _ in chunks)).i64(3, rows)
    footer = _Struct().i32(1, 1).many(2, 12, [root, *schema]).i64(3, rows).many(4, 12, [group.end()])
    footer = footer.text(6, "holdfast").end()
    out += footer + struct.pack("<I", len(footer)) + _MAGIC
    with open(path, "wb") as file:
        file.write(out)
