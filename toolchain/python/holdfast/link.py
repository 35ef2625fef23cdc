# SPDX-License-Identifier: Apache-2.0
"""The robot's end of a serial line to holdfastd: firmware/link/LINK.md in Python.

Not a certified safety function.
"""

import struct
from types import SimpleNamespace

from .tables import (
    COMMANDS,
    CONTACTS,
    EVIDENCES,
    BASES,
    FLAGS,
    FRAMES,
    FRESH_MS,
    LAST_VERSION,
    MAX_WIRE_BYTES,
    REASONS,
    RESULTS,
    STATES,
    UNITS,
    VERSION,
)

_FORMATS = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i"}
_MIN_PAYLOAD_BYTES = 4  # version, kind, CRC


def crc16(data):
    """CRC-16/CCITT-FALSE."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x11021 if crc & 0x8000 else 0)
    return crc


def cobs_encode(payload):
    """Without the delimiter. Range: runs of fewer than 254 bytes other than zero, which a payload of 35 has."""
    return b"".join(bytes([len(run) + 1]) + run for run in bytes(payload).split(b"\0"))


def cobs_decode(wire):
    """The bytes between two delimiters, decoded; None: they are no COBS."""
    if not wire or 0 in wire:
        return None
    out = bytearray()
    at = 0
    while at < len(wire):
        end = at + wire[at]
        if end > len(wire):
            return None
        out += wire[at + 1 : end]
        if end < len(wire):
            out.append(0)
        at = end
    return bytes(out)


def _sound(payload):
    return (
        payload is not None
        and len(payload) >= _MIN_PAYLOAD_BYTES
        and crc16(payload[:-2]) == int.from_bytes(payload[-2:], "little")
    )


def decode(payload):
    """The frame of a payload, CRC included: fields by their names in LINK.md, `frame` and the words for its numbers.

    None: damaged, or of a version, kind, length or state that is not in the tables.
    """
    if not _sound(payload):
        return None
    name, size, fields = FRAMES.get((payload[0], payload[1]), (None, 0, ()))
    if len(payload) != size:
        return None
    out = SimpleNamespace(frame=name)
    for field, offset, kind in fields[:-1]:
        setattr(out, field, struct.unpack_from("<" + _FORMATS[kind], payload, offset)[0])
    if name == "status":
        if payload[0] == VERSION:  # does not tell of fingers
            out.fingers = out.healthy = out.contact = 0
        if out.state not in STATES:
            return None
        out.state_name = STATES[out.state]
        out.reason_name = REASONS[out.reason][0] if out.reason in REASONS else "?"
        for flag, bit in FLAGS.items():
            setattr(out, flag, bool(out.flags >> bit & 1))
    elif name == "answer":
        out.result_name = RESULTS[out.result][0] if out.result in RESULTS else "?"
    elif name == "evidence":
        out.contact_name = CONTACTS.get(out.contact, "?")
        out.evidence_name = EVIDENCES.get(out.evidence, "?")
        out.unit_name = UNITS[out.unit] if out.unit < len(UNITS) else "?"
    elif name == "load":
        out.basis_name = BASES.get(out.basis, "?")
    return out


def command(sequence, name, argument=0):
    """The bytes of a command. Another command takes another sequence; the same bytes again ask for the answer again."""
    payload = struct.pack("<BBHBB", VERSION, 2, sequence & 0xFFFF, COMMANDS[name], argument)
    payload += crc16(payload).to_bytes(2, "little")
    return b"\0" + cobs_encode(payload) + b"\0"


def answers(answer, sequence, name):
    """Whether this answer is the command's."""
    return answer.sequence == sequence & 0xFFFF and answer.command == COMMANDS[name]


class Receiver:
    """Finds frames in what a port gives, in pieces of any size. Text between frames is passed over."""

    def __init__(self):
        self.damaged = 0  # what began as a frame and is none
        self.unknown = 0  # sound, but of a version, kind, length or state that is not in the tables
        self._piece = bytearray()
        self._text = False  # up to the next delimiter
        self._lost = False  # too long for a frame: up to the end of a line or the next delimiter

    def feed(self, data):
        """The frames that these bytes complete, in order."""
        frames = []
        for byte in data:
            if byte == 0:
                self._end(frames)
            elif self._lost:
                if byte in b"\r\n":
                    self._lost, self._text = False, True
            elif not self._text:
                self._piece.append(byte)
                if len(self._piece) == 2 and byte > LAST_VERSION:
                    self._text = True
                elif len(self._piece) == MAX_WIRE_BYTES:
                    self._lost = True
                    self.damaged += 1
        return frames

    def _end(self, frames):
        piece = b"" if self._text or self._lost else bytes(self._piece)
        self._piece.clear()
        self._text = self._lost = False
        if len(piece) < 2:
            return
        payload = cobs_decode(piece)
        if not _sound(payload):
            self.damaged += 1
            return
        frame = decode(payload)
        if frame is None:
            self.unknown += 1
        else:
            frames.append(frame)


_MS = 1_000_000  # ns
_LATE_US = FRESH_MS * 1000  # a frame's lag above the least so far
_RISE_NS = 4 * _MS  # the least lag rises by 1 us each: 250 ppm
_FALL_US = 20_000  # a backlog's lag falls by more from frame to frame
_SETTLE_NS = 500 * _MS  # without such a fall
_SILENT_NS = 1_800_000 * _MS  # a longer silence may be 2^31 us, which timestamps cannot count
_LOST = 1000  # frames; more are rather a device that starts anew
_FRAME_MS = (10, 150)  # between the timestamps of two status frames
_SURE, _NEW, _DOUBTED = range(3)


def _signed(number):
    return ((number + 0x80000000) & 0xFFFFFFFF) - 0x80000000


class Grip:
    """The receiver's rule: grip_ok counts only while the last change of `alive` is younger than 150 ms, and not where
    that frame is late: its lag, by its timestamp, is more than 150 ms above the least so far. The least rises by 250 ppm
    of the time, for clocks that differ. A delay that was there from the start cannot be seen.

    Times are time.monotonic_ns() of the caller: when the frame arrived, and now. What waited in a buffer while the
    program was stopped describes the past: discard it.
    """

    def __init__(self):
        self._alive = None
        self._changed_ns = None  # None: `alive` has not changed yet, or was found too old or late since
        self._ok = False
        self._settling = _SURE  # _NEW: the least lag is new; _DOUBTED: and frames are not believed
        self._sequence = self._timestamp_us = 0  # of the last frame whose lag was looked at
        self._least_us = 0
        self._risen_ns = 0  # up to when the least lag has risen
        self._settling_ns = 0  # since when

    def update(self, status, now_ns):
        """With every status frame."""
        self.ok(now_ns)
        if self._alive != status.alive:
            fresh = self._in_time(status, now_ns) and self._alive is not None
            self._changed_ns = now_ns if fresh else None
            self._sequence, self._timestamp_us = status.sequence, status.timestamp_us
        self._alive, self._ok = status.alive, status.grip_ok

    def ok(self, now_ns):
        """Whether the grip may be taken for good now. What was found too old stays so until `alive` changes again. A
        time that was read shortly before the last frame came is an age of 0."""
        if self._changed_ns is not None and abs(now_ns - self._changed_ns) >= FRESH_MS * _MS:
            self._changed_ns = None
        return self._ok and self._changed_ns is not None

    def _begin(self, lag_us, now_ns, settling):
        self._least_us, self._settling = lag_us, settling
        self._risen_ns = self._settling_ns = now_ns
        return settling == _NEW

    def _in_time(self, status, now_ns):
        """Whether a frame whose `alive` has changed is of now, as far as its timestamp shows."""
        lag_us = (now_ns // 1000 - status.timestamp_us) & 0xFFFFFFFF
        step_us = _signed(status.timestamp_us - self._timestamp_us)
        frames = (status.sequence - self._sequence) & 0xFFFF
        if self._alive is None:
            return self._begin(lag_us, now_ns, _NEW)
        if step_us == 0:  # a hand that goes on without its left finger: it shows nothing
            return self._settling != _DOUBTED
        silence_ns = max(now_ns - self._risen_ns, 0)
        if silence_ns > _SILENT_NS:
            return self._begin(lag_us, now_ns, _DOUBTED)
        self._least_us += silence_ns // _RISE_NS
        self._risen_ns += silence_ns // _RISE_NS * _RISE_NS
        above_us = _signed(lag_us - self._least_us)
        late = above_us > _LATE_US
        # A link that stalls changes neither the timestamps nor the sequence. A device that starts anew changes both.
        fits = frames * _FRAME_MS[0] <= step_us // 1000 <= frames * _FRAME_MS[1]
        fell_us = _FALL_US if self._settling != _SURE else _LATE_US
        anew = not fits and (late or frames == 0 or frames > _LOST)
        if anew or above_us < -fell_us:
            return self._begin(lag_us, now_ns, _DOUBTED)
        if above_us < 0:
            self._least_us = lag_us
        if now_ns - self._settling_ns >= _SETTLE_NS:
            self._settling = _SURE
        return not late and self._settling != _DOUBTED
