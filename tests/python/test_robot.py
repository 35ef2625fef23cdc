# SPDX-License-Identifier: Apache-2.0
"""The examples of toolchain/robot, and the package as pip installs it. The examples of C and C++:
tests/toolchain/robot_{link,franka}_test.cpp."""

import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tty
import unittest
from pathlib import Path

from deadline import DEADLINE_S
from holdfast import link

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])


class Hold(unittest.TestCase):
    """toolchain/robot/hold.py at the firmware's own port."""

    def start_hold(self, *arguments, errors=subprocess.DEVNULL):
        command = [sys.executable, SOURCE / "toolchain/robot/hold.py", *arguments]
        self.hold = self.start(command, subprocess.PIPE, errors)
        os.set_blocking(self.hold.stdout.fileno(), False)
        self.said = ""

    def start(self, command, output, errors=subprocess.DEVNULL):
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=errors)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def wait_for(self, pattern, between=lambda: None):
        end = time.monotonic() + DEADLINE_S
        while not re.search(pattern, self.said, re.M):
            self.assertLess(time.monotonic(), end, f"not said: {pattern}; said:\n{self.said}")
            self.said += (self.hold.stdout.read() or b"").decode()
            between()
            time.sleep(0.01)
        self.said = self.said[re.search(pattern, self.said, re.M).end() :]

    def test_believes_nothing_of_a_process_that_stands_still(self):
        work = tempfile.TemporaryDirectory()
        self.addCleanup(work.cleanup)
        port = Path(work.name, "link")
        daemon = self.start([BIN / "holdfastd", "--real-time", "--empty", "--link", port], subprocess.DEVNULL)
        end = time.monotonic() + DEADLINE_S
        while not port.exists():
            self.assertLess(time.monotonic(), end, "holdfastd made no port")
            time.sleep(0.01)
        self.start_hold(port, "--tare")
        self.wait_for(r"^TARE: done$")
        self.wait_for(r"^grip ok OK$")
        daemon.send_signal(signal.SIGSTOP)  # its last frame said "fine"
        self.wait_for(r"^not confirmed OK$")
        daemon.send_signal(signal.SIGCONT)
        self.wait_for(r"^grip ok OK$")
        daemon.kill()
        self.hold.wait(DEADLINE_S)  # the port has gone
        self.assertEqual(self.hold.returncode, 1)

    def test_believes_nothing_that_waited_while_it_stood_still(self):
        board, port = os.openpty()
        tty.setraw(port)
        os.set_blocking(board, False)
        self.addCleanup(os.close, port)
        self.addCleanup(os.close, board)
        sequence = 0

        def fine():
            nonlocal sequence
            sequence += 1
            flags = 1 << 1 | (sequence & 1) << 3  # grip_ok, alive
            taken_us = time.monotonic_ns() // 1000 & 0xFFFFFFFF
            body = struct.pack("<BBHIHBBBB4i", 1, 1, sequence, taken_us, 400, 2, 0, flags, 63, 0, 0, 0, 0)
            body += link.crc16(body).to_bytes(2, "little")
            return os.write(board, link.cobs_encode(body) + b"\0")

        self.start_hold(os.ttyname(port))
        self.wait_for(r"\Anot confirmed \(no status frame yet\)$")
        self.wait_for(r"^grip ok OK$", fine)
        self.wait_for(r"^not confirmed OK$")
        self.hold.send_signal(signal.SIGSTOP)
        try:  # more than one buffer of the kernel holds
            for _ in range(1000):
                fine()
        except BlockingIOError:
            pass
        time.sleep(1)
        self.hold.send_signal(signal.SIGCONT)
        time.sleep(1)
        self.assertIsNone(self.hold.stdout.read())
        self.wait_for(r"^grip ok OK$", fine)


    def refusal(self, *arguments, **given):
        """The one line of an end with status 1."""
        command = [sys.executable, SOURCE / "toolchain/robot/hold.py", *arguments]
        ended = subprocess.run(command, stderr=subprocess.PIPE, timeout=DEADLINE_S, **given)
        said = ended.stderr.decode()
        self.assertEqual(ended.returncode, 1, said)
        self.assertRegex(said, r"\Ahold\.py: [^\n]*\. Likely cause: [^\n]*\. Next: [^\n]*\n\Z")
        return said

    def test_refuses_what_is_no_port_in_one_line(self):
        with tempfile.TemporaryDirectory() as work:
            file, fifo = Path(work, "file"), Path(work, "fifo")
            file.write_bytes(b"")
            os.mkfifo(fifo)
            self.assertIn("No such file", self.refusal(Path(work, "missing")))
            for path in (file, fifo, work, "/dev/null"):
                self.assertIn(f"{path} is no serial port", self.refusal(path))

    def silent_port(self):
        board, port = os.openpty()
        tty.setraw(port)
        self.addCleanup(os.close, port)
        self.addCleanup(os.close, board)
        return os.ttyname(port)

    def test_ends_in_one_line_when_nobody_reads_what_it_says(self):
        reader, writer = os.pipe()
        os.close(reader)
        self.addCleanup(os.close, writer)
        self.assertIn("Broken pipe", self.refusal(self.silent_port(), stdout=writer))
        with open("/dev/full", "w") as full:
            self.assertIn("No space", self.refusal(self.silent_port(), stdout=full))
        self.assertIn("is closed", self.refusal(self.silent_port(), preexec_fn=lambda: os.close(1)))

    def test_ctrl_c_ends_it_quietly(self):
        with tempfile.TemporaryFile() as errors:
            self.start_hold(self.silent_port(), errors=errors)
            self.wait_for(r"\Anot confirmed")
            self.hold.send_signal(signal.SIGINT)
            self.assertEqual(self.hold.wait(DEADLINE_S), 0)
            errors.seek(0)
            self.assertEqual(errors.read(), b"")

    def test_says_that_tare_was_not_answered_by_a_port_that_takes_nothing(self):
        port = self.silent_port()
        filler = os.open(port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        self.addCleanup(os.close, filler)
        with tempfile.TemporaryFile() as errors:
            begun = time.monotonic()
            self.start_hold(port, "--tare", errors=errors)
            self.wait_for(r"\Anot confirmed")  # it has emptied the port
            said = b""
            while b"\n" not in said:
                self.assertLess(time.monotonic() - begun, DEADLINE_S)
                try:
                    os.write(filler, bytes(4096))
                except BlockingIOError:
                    time.sleep(0.01)
                errors.seek(0)
                said = errors.read()
            self.assertRegex(said, rb"\Ahold\.py: TARE was not answered\. Likely cause: .*\. Next: .*\n\Z")
            self.assertIsNone(self.hold.poll())


class UrScript(unittest.TestCase):
    """toolchain/robot/holdfast.script, turned into Python line by line. What a UR controller itself makes of it is not
    tried here."""

    STEP_S = 0.002

    def setUp(self):
        lines = []
        for line in (SOURCE / "toolchain/robot/holdfast.script").read_text().splitlines():
            line = re.sub(r"^(\s*)local ", r"\1", line.split("#")[0].rstrip())
            line = re.sub(r"^thread (\w+\(\)):", r"def \1:\n  global holdfast_ok", line)
            line = re.sub(r"\b(sync\(\))", r"yield", line)
            line = re.sub(r"^(\s*)(speedl\(.*\))", r"\1\2\n\1yield", line)
            line = re.sub(r"^global ", "", line)
            if line.strip() != "end":
                lines.append(line)
        self.inputs, self.moves = [False, False], []
        self.program = {
            "get_tool_digital_in": lambda number: self.inputs[number],
            "get_steptime": lambda: self.STEP_S,
            "speedl": lambda speed, acceleration, seconds: self.moves.append(speed[2]),
            "stopl": lambda acceleration: self.moves.append(0.0),
        }
        exec("\n".join(lines), self.program)
        self.thread = self.program["holdfast_watch"]()
        next(self.thread)

    def step(self, alive, grip_ok):
        self.inputs[:] = alive, grip_ok
        next(self.thread)
        return self.program["holdfast_ok"]

    def test_the_rule_as_it_is_written(self):
        """Drawn levels at every step of 2 ms; the age of an edge, in whole steps, from all levels so far."""
        draw = random.Random(3)
        levels = [False]
        for _ in range(60):
            level, grip_ok = draw.random() < 0.5, draw.random() < 0.8
            for _ in range(draw.choice((1, 20, 60, 74, 75, 76, 200))):
                levels.append(level)
                edges = [k for k in range(1, len(levels)) if levels[k] != levels[k - 1]]
                fresh = bool(edges) and 2 * (len(levels) - 1 - edges[-1]) < 150
                self.assertEqual(self.step(level, grip_ok), fresh and grip_ok)

    def test_the_lift_ends_when_the_grip_is_not_confirmed(self):
        self.step(True, True)
        lift = self.program["holdfast_lift"](2.0)
        for k in range(200):
            next(lift)
            self.step(k % 40 < 20, True)
        self.assertEqual(set(self.moves), {0.02})
        self.step(True, False)
        with self.assertRaises(StopIteration) as end:
            next(lift)
        self.assertIs(end.exception.value, False)
        self.assertEqual(self.moves[-1], 0.0)

    def test_the_lift_goes_all_the_way(self):
        self.step(True, True)
        lift = self.program["holdfast_lift"](0.5)
        steps = 0
        with self.assertRaises(StopIteration) as end:
            while True:
                next(lift)
                steps += 1
                self.step(steps % 40 < 20, True)
        self.assertIs(end.exception.value, True)
        self.assertAlmostEqual(steps * self.STEP_S, 0.5, delta=self.STEP_S)  # the last step may be one too many


class Package(unittest.TestCase):
    def test_pip_installs_it(self):
        tried = subprocess.run([sys.executable, "-c", "import setuptools, wheel, pip"], capture_output=True)
        if tried.returncode:
            self.skipTest("no pip, setuptools and wheel")
        with tempfile.TemporaryDirectory() as work:
            folder = shutil.copytree(SOURCE / "toolchain/python", Path(work, "source"))
            here = f"{work}/here"
            alone = ["--no-index", "--no-deps", "--no-build-isolation"]
            pip = [sys.executable, "-m", "pip", "install", *alone, "--target", here, folder]
            subprocess.run(pip, check=True, timeout=300, capture_output=True)
            asked = [sys.executable, "-c", "import holdfast.link, holdfast.logs; print(holdfast.__file__)"]
            environment = {"PATH": os.environ["PATH"], "PYTHONPATH": here}
            where = subprocess.run(asked, check=True, timeout=60, capture_output=True, text=True, env=environment)
            self.assertTrue(where.stdout.startswith(here))


if __name__ == "__main__":
    unittest.main()
