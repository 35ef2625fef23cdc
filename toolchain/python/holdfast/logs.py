# SPDX-License-Identifier: Apache-2.0
"""Reads what `holdfast replay|sim --mcap, --log, --features, --markers, --truth` and `holdfast record` write.

Columns are NumPy arrays where numpy can be imported, lists otherwise.
"""

import csv
import re
import struct
import zlib
from collections import namedtuple

try:
    import numpy
except ImportError:
    numpy = None

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0C, 0x0F
_NUMBERS = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip

Message = namedtuple("Message", "topic time_ns values")


class LogError(ValueError):
    """What is wrong with a file, its likely cause and the next step."""


def _broken(path, what):
    cause = "the writer was killed, or the copy is incomplete"
    return LogError(f"{path}: {what}. Likely cause: {cause}. Next: holdfast log info {path}")


def _foreign(path, what):
    next_step = "give one that holdfast --mcap wrote"
    return LogError(f"{path}: {what}. Likely cause: another program wrote it. Next: {next_step}")


def _column(values):
    """An array, unless these are texts, pictures or arrays of several lengths."""
    if numpy is None or not values or isinstance(values[0], (str, bytes, list)):
        return values
    if hasattr(values[0], "shape") and len({value.shape for value in values}) > 1:
        return values
    return numpy.array(values)


def _cell(text):
    if not text:
        return float("nan")
    try:
        return int(text)
    except ValueError:
        return float(text)


def read_csv(path):
    """Columns by name: numbers, nan where a cell is empty; a column with words stays text."""
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    if not rows:
        raise _broken(path, "the file is empty")
    if any(len(row) != len(rows[0]) for row in rows):
        raise _broken(path, "a row has not as many cells as the header")
    columns = {}
    for number, name in enumerate(rows[0]):
        cells = [row[number] for row in rows[1:]]
        try:
            columns[name] = _column([_cell(cell) for cell in cells])
        except ValueError:
            columns[name] = cells
    return columns


class _Type:
    """A message type, from the text of its schema (ros2msg)."""

    def __init__(self, name, text):
        sections = re.split(r"^=+\nMSG: (\S+)\n", text, flags=re.M)
        self.texts = dict(zip([name] + sections[1::2], sections[::2]))
        self.fields = self._fields(name)

    def _fields(self, name):
        fields = []
        for line in self.texts[name].splitlines():
            match = re.match(r"\s*([\w/]+)(\[\d*\])?\s+(\w+)\s*(?:#.*)?$", line)  # a constant has a "=": it is not sent
            if match:
                kind, array, field = match.groups()
                inner = None if kind in _NUMBERS or kind == "string" else self._fields(kind)
                fields.append((field, kind, array, inner))
        return fields


class _Cdr:
    """XCDR1, little endian."""

    def __init__(self, data):
        self.data = data
        self.at = 4
        if data[:4] != b"\0\1\0\0":
            raise struct.error("not little-endian CDR")

    def numbers(self, kind, count):
        code = _NUMBERS[kind]
        size = struct.calcsize(code)
        self.at += -(self.at - 4) % size
        values = struct.unpack_from(f"<{count}{code}", self.data, self.at)
        self.at += size * count
        return values

    def one(self, kind, inner):
        if inner is not None:
            return self.message(inner)
        if kind != "string":
            return self.numbers(kind, 1)[0]
        size = self.numbers("uint32", 1)[0]
        text = self.data[self.at : self.at + size]
        self.at += size
        if len(text) < size or text[-1:] != b"\0":
            raise struct.error("a text without its end")
        return text[:-1].decode("utf-8", "replace")

    def many(self, kind, inner, array):
        count = int(array[1:-1]) if len(array) > 2 else self.numbers("uint32", 1)[0]
        if kind not in _NUMBERS:
            if count > len(self.data):
                raise struct.error("more elements than bytes")
            return [self.one(kind, inner) for _ in range(count)]
        values = self.numbers(kind, count)
        if kind in ("uint8", "byte") and len(array) == 2:
            return bytes(values)
        return list(values) if numpy is None else numpy.array(values)

    def message(self, fields):
        return {
            field: self.one(kind, inner) if array is None else self.many(kind, inner, array)
            for field, kind, array, inner in fields
        }


def _text(data, at):
    size = struct.unpack_from("<I", data, at)[0]
    if at + 4 + size > len(data):
        raise struct.error("a text that is longer than its record")
    return data[at + 4 : at + 4 + size].decode("utf-8", "replace"), at + 4 + size


def _records(data, at):
    while at < len(data):
        opcode, size = struct.unpack_from("<BQ", data, at)
        if at + 9 + size > len(data):
            raise struct.error("a record that is longer than the file")
        yield opcode, data[at + 9 : at + 9 + size]
        at += 9 + size


class Mcap:
    """An MCAP file with ros2msg schemas and CDR messages, uncompressed: what Holdfast writes.

    The check sums of its chunks are verified. A file that breaks off gives its messages up to there, then a LogError.
    """

    def __init__(self, path):
        self.path = path
        self.metadata = {}  # name: {key: value}; complete once messages() has come to its end
        self._schemas = {}
        self._channels = {}
        with open(path, "rb") as file:
            self._data = file.read()
        if not self._data.startswith(_MAGIC):
            raise _foreign(path, "no MCAP file")

    def messages(self, topic=None):
        """In the order of the file; of one topic, where it is given."""
        try:
            for opcode, content in _records(self._data, len(_MAGIC)):
                if opcode == _DATA_END:
                    return
                if opcode == _METADATA:
                    self._metadata(content)
                if opcode == _CHUNK:
                    yield from self._chunk(content, topic)
        except (struct.error, KeyError) as error:
            raise _broken(self.path, f"broken: {error}") from error
        raise _broken(self.path, "it breaks off")

    def topics(self):
        """Schema names by topic."""
        for _ in self.messages(topic=""):
            pass
        return {topic: name for topic, name, _ in self._channels.values()}

    def table(self, topic):
        """Columns by name. A field of a message inside is "header.stamp.sec"; `time_ns` is when it was logged.

        Arrays of one length become a column of two dimensions.
        """
        rows = []
        for message in self.messages(topic):
            row = {"time_ns": message.time_ns}
            _flatten(row, "", message.values)
            rows.append(row)
        return {name: _column([row[name] for row in rows]) for name in (rows[0] if rows else ())}

    def _metadata(self, content):
        name, at = _text(content, 0)
        end = at + 4 + struct.unpack_from("<I", content, at)[0]
        at += 4
        entries = self.metadata[name] = {}
        while at < end:
            key, at = _text(content, at)
            entries[key], at = _text(content, at)

    def _chunk(self, content, topic):
        crc = struct.unpack_from("<I", content, 24)[0]
        compression, at = _text(content, 28)
        if compression:
            raise _foreign(self.path, f"compressed ({compression}), which this does not read")
        records = content[at + 8 :]
        if crc and zlib.crc32(records) != crc:
            raise _broken(self.path, "a chunk whose check sum is wrong")
        for opcode, record in _records(records, 0):
            if opcode == _SCHEMA:
                name, at = _text(record, 2)
                encoding, at = _text(record, at)
                self._schemas[struct.unpack_from("<H", record)[0]] = (name, encoding, _text(record, at)[0])
            elif opcode == _CHANNEL:
                number, schema = struct.unpack_from("<HH", record)
                name, encoding, text = self._schemas[schema]
                where, at = _text(record, 4)
                if (encoding, _text(record, at)[0]) != ("ros2msg", "cdr"):
                    raise _foreign(self.path, f"{where} is no ros2msg in CDR")
                self._channels[number] = (where, name, _Type(name, text).fields)
            elif opcode == _MESSAGE:
                number, _, time_ns = struct.unpack_from("<HIQ", record)
                where, _, fields = self._channels[number]
                if topic is None or topic == where:
                    yield Message(where, time_ns, _Cdr(record[22:]).message(fields))


def _flatten(row, prefix, values):
    for name, value in values.items():
        if isinstance(value, dict):
            _flatten(row, prefix + name + ".", value)
        else:
            row[prefix + name] = value
