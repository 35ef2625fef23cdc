# SPDX-License-Identifier: Apache-2.0
"""toolchain/python/holdfast/link.py against the firmware: bytes that it sent, and what its decoder makes of them."""

import json
import os
import random
import re
import subprocess
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace

from holdfast import link, tables

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])


def example(number):
    """The bytes of an example of LINK.md, which the firmware's encoder wrote."""
    blocks = re.findall(r"```\n([0-9a-f \n]+)```", (SOURCE / "firmware/link/LINK.md").read_text())
    return bytes.fromhex(blocks[number])


def hear(data, piece=None):
    receiver, frames = link.Receiver(), []
    for at in range(0, len(data), piece or len(data)):
        frames += receiver.feed(data[at : at + (piece or len(data))])
    return receiver, frames


class Session(unittest.TestCase):
    """A simulated grasp as a board sends it: status, evidence and marker frames between lines of text, two of them damaged."""

    @classmethod
    def setUpClass(cls):
        with tempfile.TemporaryDirectory() as work:
            sent, values = Path(work, "bytes"), Path(work, "values")
            scene = SOURCE / "tests/scenes/sphere_slip.json"
            subprocess.run([BIN / "session_bytes", scene, sent, values], check=True, timeout=300)
            cls.sent, cls.values = sent.read_bytes(), json.loads(values.read_text())
        cls.wires = []  # of sound frames, with their end
        for piece in cls.sent.split(b"\0"):
            payload = link.cobs_decode(piece) if len(piece) in (28, 31, 33) else None
            if payload and link.decode(payload):
                cls.wires.append(piece + b"\0")

    def test_every_value_in_pieces_of_any_size(self):
        for size in (1, 2, 7, 33, 34, 255, len(self.sent)):
            receiver, frames = hear(self.sent, size)
            self.assertEqual(receiver.damaged, self.values["damaged"])
            self.assertEqual(receiver.unknown, 0)
            self.assertEqual(len(frames), self.values["frames"])
            got = [frame for frame in frames if frame.frame == "status"]
            self.assertEqual(len(got), len(self.values["status"]))
            for frame, want in zip(got, self.values["status"]):
                words = {"state": frame.state_name, "reason": frame.reason_name}
                for name, value in want.items():
                    self.assertEqual(words.get(name, getattr(frame, name)), value, name)
                    self.assertIs(type(words.get(name, getattr(frame, name))), type(value))

    def test_every_evidence(self):
        got = [frame for frame in hear(self.sent)[1] if frame.frame == "evidence"]
        self.assertEqual(len(got), len(self.values["evidence"]))
        self.assertGreater(len({frame.evidence_name for frame in got}), 1)
        for frame, want in zip(got, self.values["evidence"]):
            for name, value in want.items():
                words = {"contact": "contact_name", "evidence": "evidence_name", "unit": "unit_name"}
                self.assertEqual(getattr(frame, words.get(name, name)), value, name)

    def test_every_displacement(self):
        got = {}
        for frame in hear(self.sent)[1]:
            if frame.frame == "displacement":
                for k in range(5):
                    place = (getattr(frame, f"x{k}_um"), getattr(frame, f"y{k}_um"))
                    got[frame.sequence, frame.first + k] = list(place) if frame.valid >> k & 1 else None
        missing = 0
        for field in self.values["fields"]:
            for index, want in enumerate(field["um"]):
                if (field["sequence"], index) in got:
                    self.assertEqual(got[field["sequence"], index], want)
                else:
                    missing += 1
        self.assertEqual(missing, 5)  # of the damaged frame

    def test_every_single_bit_flip_is_refused(self):
        flips = 0
        for wire in self.wires[:40] + [example(1), example(2), example(3)]:
            for bit in range(8 * len(wire)):
                bad = bytearray(wire)
                bad[bit // 8] ^= 1 << bit % 8
                self.assertEqual(hear(b"\0" + bad + b"\0")[1], [])
                flips += 1
        self.assertGreater(flips, 10_000)

    def test_hears_the_next_frame_behind_any_junk(self):
        draw = random.Random(1)
        for i in range(2000):
            junk = bytes(draw.randrange(8 if i % 2 else 256) for _ in range(draw.randrange(100)))
            frames = hear(junk + b"\0" + self.wires[0])[1]
            self.assertEqual(vars(frames[-1]), vars(hear(self.wires[0])[1][0]))


class Frames(unittest.TestCase):
    def test_the_catalogue_and_the_papers_examples(self):
        self.assertEqual(link.crc16(b"123456789"), 0x29B1)
        cases = {"01": "", "0101": "00", "010101": "0000", "0311220233": "11220033", "0511223344": "11223344"}
        for wire, plain in cases.items():
            self.assertEqual(link.cobs_decode(bytes.fromhex(wire)).hex(), plain)
            self.assertEqual(link.cobs_encode(bytes.fromhex(plain)).hex(), wire)
        for wire in ("", "05112233", "0511002233", "00"):
            self.assertIsNone(link.cobs_decode(bytes.fromhex(wire)))

    def test_the_examples_of_the_document(self):
        status = hear(example(0))[1][0]
        self.assertEqual((status.version, status.sequence), (1, 513))
        self.assertEqual((status.timestamp_us, status.age_100us), (16909060, 412))
        self.assertEqual((status.state_name, status.reason_name, status.markers), ("SLIP", "slip", 63))
        self.assertEqual((status.slip, status.grip_ok, status.features_valid, status.alive), (True, False, True, True))
        self.assertEqual((status.vx_um_s, status.vy_um_s), (-1500, 250))
        self.assertEqual((status.entropy_nat_q16, status.entropy_rate_nat_s_q8), (131072, 1024))
        self.assertEqual(link.command(258, "TARE", 1), b"\0" + example(1))
        answer = hear(example(2))[1][0]
        self.assertEqual((answer.frame, answer.result_name), ("answer", "done"))
        self.assertTrue(link.answers(answer, 258, "TARE"))
        self.assertFalse(link.answers(answer, 259, "TARE"))
        self.assertFalse(link.answers(answer, 258, "ARM"))
        why = hear(example(3))[1][0]
        self.assertEqual((why.sequence, why.finger, why.contact_name, why.run), (513, 0, "HELD", 2))
        self.assertEqual((why.evidence_name, why.value_milli, why.threshold_milli), ("imprint", 61440, 34000))
        self.assertEqual((why.unit_name, why.patches, why.growth_log2_q8), ("um", 45, -12))
        load = hear(example(4))[1][0]
        self.assertEqual((load.sequence, load.finger, load.basis_name, load.flags), (513, 0, "one_weight", 1))
        self.assertEqual((load.shear_x_mn, load.shear_y_mn, load.normal_mn), (-300, 400, 1250))
        self.assertEqual(load.friction_use_permille, 400)

    def test_the_example_of_a_hand(self):
        hand, status = hear(example(5))[1][0], hear(example(0))[1][0]
        self.assertEqual((hand.version, hand.fingers, hand.healthy, hand.contact), (2, 3, 2, 3))
        self.assertEqual((status.fingers, status.healthy, status.contact), (0, 0, 0))
        for name in ("sequence", "timestamp_us", "state_name", "slip", "alive", "markers", "vx_um_s", "entropy_nat_q16"):
            self.assertEqual(getattr(hand, name), getattr(status, name), name)

    def test_what_it_does_not_know_is_counted_and_passed_over(self):
        def wire(body):
            return link.cobs_encode(bytes(body) + link.crc16(bytes(body)).to_bytes(2, "little")) + b"\0"

        no_such_state = bytearray(30)
        no_such_state[:2], no_such_state[10] = b"\1\1", 6
        for body in ([8, 1, 0, 0], [1, 9, 0, 0], [1, 1, 0, 0], no_such_state):
            receiver, frames = hear(wire(body))
            self.assertEqual((frames, receiver.unknown, receiver.damaged), ([], 1, 0))

    def test_the_layouts_are_those_of_the_document(self):
        """Each table of LINK.md that lists bytes, by its version: a new version there fails here until it is read."""
        document = (SOURCE / "firmware/link/LINK.md").read_text()
        found = 0
        for title, version, table in re.findall(r"## (\w+) frames?, version (\d+)\n(.*?)(?=\n#)", document, re.S):
            rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (\w+) \|", table, re.M)
            want = tuple((name, int(byte), kind) for byte, name, kind in rows)
            kinds = {"Status": [1], "Command": [2], "Answer": [3], "Marker": [4, 5], "Evidence": [6], "Load": [7]}
            for kind in kinds[title]:
                self.assertEqual(tables.FRAMES[int(version), kind][2], want)
                found += 1
        self.assertEqual(found, len(tables.FRAMES))

    def test_numbers_and_names_are_those_of_the_header_for_c(self):
        header = (SOURCE / "toolchain/robot/holdfast_link.h").read_text()
        enum = {}
        line = r"^  HOLDFAST_(FLAG|STATE|REASON|COMMAND|RESULT|CONTACT|EVIDENCE|BASIS)_(\w+) = (\d+)"
        for kind, name, number in re.findall(line, header, re.M):
            if not name.endswith(("PAYLOAD", "WIRE")):
                enum.setdefault(kind, {})[int(number)] = name
        self.assertEqual({1 << bit: name.upper() for name, bit in tables.FLAGS.items()}, enum["FLAG"])
        self.assertEqual(tables.STATES, enum["STATE"])
        self.assertEqual({n: row[0].upper() for n, row in tables.REASONS.items()}, enum["REASON"])
        self.assertEqual({number: name for name, number in tables.COMMANDS.items()}, enum["COMMAND"])
        self.assertEqual({n: row[0].upper() for n, row in tables.RESULTS.items()}, enum["RESULT"])
        self.assertEqual(tables.CONTACTS, enum["CONTACT"])
        self.assertEqual({n: name.upper() for n, name in tables.EVIDENCES.items()}, enum["EVIDENCE"])
        self.assertEqual({n: name.upper() for n, name in tables.BASES.items()}, enum["BASIS"])


class ReceiversRule(unittest.TestCase):
    MS = 1_000_000

    def hear(self, grip, alive, ok, now_ms):
        frame = SimpleNamespace(alive=alive, grip_ok=ok, sequence=0, timestamp_us=0)  # which stands still: shows nothing
        grip.update(frame, now_ms * self.MS)

    def test_counts_for_149_milliseconds(self):
        ages = {0: True, 149: True, 150: False, 151: False, 10**9: False, -1: True, -149: True, -150: False}
        for age_ms, want in ages.items():
            grip = link.Grip()
            self.assertFalse(grip.ok(0))
            self.hear(grip, False, True, 960)
            self.assertFalse(grip.ok(960 * self.MS))  # a first level may be an old one
            self.hear(grip, True, True, 1000)
            self.assertEqual(grip.ok((1000 + age_ms) * self.MS), want)
        grip = link.Grip()
        self.hear(grip, False, True, 960)
        self.hear(grip, True, True, 1000)
        self.assertTrue(grip.ok(1150 * self.MS - 1))

    def test_an_asker_whose_clock_was_read_before_the_frame_came(self):
        grip = link.Grip()
        self.hear(grip, False, True, 1000)
        self.hear(grip, True, True, 1040)
        said = [grip.ok(now_ms * self.MS) for now_ms in (1039, 1041, 1075, 1190, 1041)]
        self.assertEqual(said, [True, True, True, False, False])  # what was found too old stays so

    def test_against_the_rule_as_it_is_written(self):
        """Drawn frames; the rule looks at all of them each time."""
        draw = random.Random(2)
        for _ in range(300):
            grip, heard, now_ms = link.Grip(), [], 0
            for _ in range(60):
                now_ms += draw.choice((1, 20, 40, 149, 150, 151))
                if draw.random() < 0.7:
                    heard.append((now_ms, draw.random() < 0.5, draw.random() < 0.8))
                    self.hear(grip, heard[-1][1], heard[-1][2], now_ms)
                changes = [b[0] for a, b in zip(heard, heard[1:]) if a[1] != b[1]]
                want = bool(changes) and now_ms - changes[-1] < 150 and heard[-1][2]
                self.assertEqual(grip.ok(now_ms * self.MS), want)

    def test_late_frames_as_the_header_for_c(self):
        """The draws and the sum of tests/toolchain/robot_link_test.cpp, whose oracle knows how old each frame is."""
        x = 1

        def draw(below):
            nonlocal x
            x = (x * 1664525 + 1013904223) & 0xFFFFFFFF
            return (x >> 8) % below

        total = fine = 0
        now, stamp, sequence, wait, alive = 0xFFFF0000, 0xFFF00000, 65_000, 40, False
        grip = link.Grip()
        for k in range(100_000):
            mode = draw(4) if k % 64 == 0 else 4
            if mode < 4:
                wait = 3 if mode == 2 else 40
            if mode == 2:
                now += 200 + draw(3_000)
            if mode == 3:
                stamp = draw(1 << 24) * 256
                sequence = draw(65_536)
            if draw(2_000) == 0:
                now += 1_900_000
            now += wait + draw(8)
            stamp = (stamp + 38_000 + draw(4_000)) & 0xFFFFFFFF
            alive = alive != (draw(16) != 0)
            sequence = (sequence + 1) & 0xFFFF
            ok = draw(16) != 0
            grip.update(SimpleNamespace(alive=alive, grip_ok=ok, sequence=sequence, timestamp_us=stamp), now * self.MS)
            for later in (0, draw(40), -draw(4)):
                answer = grip.ok((now + later) * self.MS)
                total = (total * 31 + answer) & 0xFFFFFFFF
                fine += answer
        self.assertEqual((fine, total), (64_491, 2_265_733_411))


if __name__ == "__main__":
    unittest.main()
