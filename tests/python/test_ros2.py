# SPDX-License-Identifier: Apache-2.0
"""holdfast-ros2 (Cyclone DDS) heard by another vendor's DDS (tests/ros2/fast_dds_peer.cpp), on loopback; and its
messages: the .msg files against what MCAP files carry, holdfast.idl against the .msg files, and both by ROS 2's own
generators where they are installed. What is not here: a ROS 2."""

import json
import os
import random
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
import tty
import unittest
from pathlib import Path

from deadline import DEADLINE_S
from holdfast import link, logs

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])
ROS2 = SOURCE / "toolchain/ros2"
OURS = ("SlipState", "MarkerField", "Command", "Answer")
LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<Peers><Peer Address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""

for built, package in (("holdfast-ros2", "cyclonedds-dev and cyclonedds-tools"), ("fast_dds_peer", "libfastrtps-dev")):
    if not (BIN / built).exists():
        print(f"SKIPPED: {built} was not built, without {package}. Next: tests/run.sh --only packages")
        sys.exit(77)


def fnv1a(data):
    total = 14695981039346656037
    for byte in data:
        total = (total ^ byte) * 1099511628211 % 2**64
    return total


class Heard(unittest.TestCase):
    def setUp(self):
        self.work = tempfile.TemporaryDirectory()
        self.addCleanup(self.work.cleanup)
        # Ports of its own, beside other runs, and below 32768, where the kernel gives ports to whoever asks.
        self.domain = str(random.SystemRandom().randrange(1, 100))
        self.samples, self.partial = {}, b""

    def start(self, command, **more):
        process = subprocess.Popen([str(part) for part in command], **more)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def bridge(self, *options):
        environment = dict(os.environ, CYCLONEDDS_URI=LOOPBACK)
        command = [BIN / "holdfast-ros2", "--domain", self.domain, *options]
        return self.start(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)

    def peer(self):
        command = [BIN / "fast_dds_peer", self.domain]
        self.fast = self.start(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(self.fast.stdout.close)
        self.addCleanup(self.fast.stdin.close)

    def command(self, number, argument):
        self.fast.stdin.write(b"%d %d\n" % (number, argument))
        self.fast.stdin.flush()

    def until(self, what, holds, meanwhile=lambda: None):
        end = time.monotonic() + DEADLINE_S
        while not holds():
            self.assertLess(time.monotonic(), end, what)
            meanwhile()
            if select.select([self.fast.stdout], [], [], 0.01)[0]:
                lines = (self.partial + os.read(self.fast.stdout.fileno(), 1 << 20)).split(b"\n")
                self.partial = lines.pop()
                for line in lines:
                    sample = json.loads(line)
                    self.assertNotIn("error", sample)
                    self.assertIn(sample.pop("rest"), range(4))
                    self.samples.setdefault(sample.pop("topic"), []).append(sample)

    def heard(self, topic):
        return self.samples.get(topic, [])

    def ask(self, number, result, meanwhile=lambda: None):
        """Publishes a command every second until this is heard of it. DDS drops what is written before writer and
        reader have found each other, in both directions, and neither side can see when the other one has; a machine
        under load may also answer later than the bridge waits."""
        again = 0

        def turn():
            nonlocal again
            meanwhile()
            if time.monotonic() >= again:
                self.command(number, 0)
                again = time.monotonic() + 1

        self.until(
            f"{result} of {number}",
            lambda: any(
                (one["command"], one["result_name"]) == (number, result) for one in self.heard("rt/holdfast/answer")
            ),
            turn,
        )

    def test_what_a_board_says(self):
        board = tty_board(self)
        self.bridge("--link", board.path, "--hardware", "HF0001")
        self.peer()
        self.until("the two have found each other", lambda: self.heard("rt/holdfast/slip"), board.say)
        board.sequence += 3  # three frames are lost
        board.fields.update(state=3, reason=98, flags=1 | 4, markers=60, vx=-1500, vy=250, entropy=131072, rate=-1024)
        before = time.time()
        self.until("the slip", lambda: self.heard("rt/holdfast/slip")[-1]["slip"], board.say)
        after = time.time()
        slips = self.heard("rt/holdfast/slip")
        first = next(k for k, one in enumerate(slips) if one["slip"])
        self.assertGreaterEqual(slips[first]["frame"], slips[first - 1]["frame"] + 4)  # lost ones are counted
        numbers = [one["frame"] for one in slips]
        self.assertEqual(numbers, sorted(set(numbers)))
        got = slips[first]
        stamp = got.pop("sec") + got.pop("nanosec") / 1e9
        self.assertTrue(before - 0.040 - 0.001 <= stamp <= after - 0.040 + 0.001)  # exposed 40 ms before it was sent
        want = {
            "frame_id": "gel", "state": 3, "state_name": "SLIP", "reason": 98, "reason_name": "slip", "slip": True,
            "grip_ok": False, "features_valid": True, "rates_valid": False, "markers": 60, "vx_mm_s": -1.5,
            "vy_mm_s": 0.25, "entropy_nat": 2.0, "entropy_rate_nat_s": -4.0, "contact_known": False, "evidence": 0,
            "histogram": [0] * 15,
        }  # fmt: skip
        self.assertEqual({name: got[name] for name in want}, want)

        def last():
            return (self.heard("rt/diagnostics") or [{}])[-1]

        # Diagnostics come once a second, and a second of silence is stale: the board must go on speaking.
        self.until("rates", lambda: self.heard("rt/holdfast/slip")[-1]["rates_valid"], board.say)  # none were lost since
        self.until("a warning", lambda: last().get("message") == "SLIP (slip)", board.say)
        self.assertEqual((last()["level"], last()["hardware_id"]), (1, "HF0001"))
        self.until("silence is stale", lambda: last()["level"] == 3)
        self.assertEqual(last()["values"]["lost"], "3")
        board.fields.update(state=5, reason=1, flags=0)
        self.until("an error", lambda: last()["level"] == 2, board.say)
        board.fields.update(state=2, reason=0, flags=2)
        board.sequence = (board.sequence - 5000) % 65536  # holdfastd starts anew
        self.until("all is well", lambda: last()["level"] == 0, board.say)
        frames = int(last()["values"]["frames"])
        self.until("they are counted", lambda: int(last()["values"]["frames"]) > frames, board.say)
        self.assertEqual(last()["values"]["lost"], "3")

    def test_commands_are_repeated_until_they_are_answered(self):
        board = tty_board(self)
        self.bridge("--link", board.path, "--commands")
        self.peer()
        opening, arm, grip = (link.COMMANDS[name] for name in ("OPENING", "ARM", "GRIP"))
        heard = []

        def listen(deaf_for):
            board.say()
            for one in board.commands():
                heard.append(one)
                if sum(other.sequence == one.sequence for other in heard) > deaf_for:
                    board.answer(one, 6)

        def answers(command):
            return [one for one in self.heard("rt/holdfast/answer") if one["command"] == command]

        def tries(command):
            return [one for one in heard if one.command == command]

        self.ask(grip, "overdue", lambda: listen(0))
        self.command(opening, 1)
        self.until("an answer", lambda: answers(opening), lambda: listen(2))  # two are lost on the way
        want = {"command": 2, "argument": 1, "result": 6, "result_name": "overdue"}
        self.assertEqual(answers(opening), [want])
        self.assertEqual({(one.sequence, one.argument) for one in tries(opening)}, {(tries(opening)[0].sequence, 1)})
        self.assertGreaterEqual(len(tries(opening)), 3)
        self.command(arm, 0)
        self.until("nobody answered", lambda: answers(arm) and len(tries(arm)) >= 5, lambda: listen(5))
        self.assertEqual(answers(arm), [{"command": 4, "argument": 0, "result": 255, "result_name": "silent"}])
        self.assertEqual(len(tries(arm)), 5)

    def test_a_real_holdfastd_obeys(self):
        port = Path(self.work.name, "link")
        quiet = dict(stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        self.start([BIN / "holdfastd", "--real-time", "--empty", "--link", port], **quiet)
        self.bridge("--link", port, "--commands")
        self.peer()
        self.until("the grip is fine", lambda: any(one["grip_ok"] for one in self.heard("rt/holdfast/slip")))
        self.ask(link.COMMANDS["TARE"], "done")
        self.until("it learns", lambda: any(one["state_name"] == "REFERENCE" for one in self.heard("rt/holdfast/slip")))

    def test_a_recording(self):
        file = Path(self.work.name, "mcap")
        replay = [BIN / "holdfast", "replay", SOURCE / "tests/data/slip.mjpg", "--mcap", file]
        subprocess.run(replay, check=True, timeout=300, stdout=subprocess.DEVNULL)
        messages = list(logs.Mcap(file).messages())
        self.peer()
        self.bridge("--mcap", file, "--again")
        slips = {m.values["frame"]: m.values for m in messages if m.topic == "/holdfast/slip"}
        pictures = {fnv1a(m.values["data"]) for m in messages if m.topic == "/holdfast/camera"}
        fields = {m.values["frame"]: m.values for m in messages if m.topic == "/holdfast/markers"}
        self.assertEqual((len(slips), len(pictures), len(fields)), (16, 16, 16))

        def all_came():
            return (
                {one["frame"] for one in self.heard("rt/holdfast/slip")} == set(slips)
                and {one["fnv1a"] for one in self.heard("rt/holdfast/camera/compressed")} == pictures
                and {one["frame"] for one in self.heard("rt/holdfast/markers")} == set(fields)
            )

        self.until("every message", all_came)
        now = time.time()
        for topic, wanted in (("rt/holdfast/slip", slips), ("rt/holdfast/markers", fields)):
            for got in self.heard(topic):
                self.assertLess(abs(got.pop("sec") - now), DEADLINE_S)  # wall clock, not the recording's
                del got["nanosec"], got["frame_id"]
                for name, value in got.items():
                    want = wanted[got["frame"]][name]
                    self.assertEqual(
                        value, list(want) if hasattr(want, "__len__") and not isinstance(want, str) else want
                    )


class tty_board:
    """A board as a pseudo terminal: each say() is a frame, 10 ms apart at least."""

    def __init__(self, test):
        self.end, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.end, False)
        self.path = os.ttyname(slave)
        test.addCleanup(os.close, self.end)
        test.addCleanup(os.close, slave)
        self.sequence = 65_530
        self.receiver = link.Receiver()
        self.fields = dict(state=2, reason=0, flags=2, markers=0, vx=0, vy=0, entropy=0, rate=0)
        self.alive = False

    def say(self):
        self.sequence += 1
        self.alive = not self.alive
        f = self.fields
        words = (self.sequence % 65536, 0, 400, f["state"], f["reason"], f["flags"] | 8 * self.alive, f["markers"])
        body = link.struct.pack("<BBHIHBBBB4i", 1, 1, *words, f["vx"], f["vy"], f["entropy"], f["rate"])
        self.write(body)
        time.sleep(0.01)

    def write(self, body):
        try:
            os.write(self.end, link.cobs_encode(body + link.crc16(body).to_bytes(2, "little")) + b"\0")
        except BlockingIOError:
            self.sequence -= 1  # nobody reads yet

    def commands(self):
        try:
            return [frame for frame in self.receiver.feed(os.read(self.end, 4096)) if frame.frame == "command"]
        except BlockingIOError:
            return []

    def answer(self, command, result):
        self.write(link.struct.pack("<BBHBB", 1, 3, command.sequence, command.command, result))


def lines_of(text):
    """The fields of a .msg, without comments and constants."""
    bare = (line.split("#")[0].strip() for line in text.splitlines())
    return [line for line in bare if line and "=" not in line]


class Messages(unittest.TestCase):
    def test_a_domain_that_is_none_is_refused(self):
        for domain in ("abc", "7x", "233", "-1", "99999999999"):
            tried = subprocess.run(
                [BIN / "holdfast-ros2", "--link", "/dev/null"],
                env={**os.environ, "ROS_DOMAIN_ID": domain},
                capture_output=True,
                text=True,
                timeout=60,
            )
            self.assertEqual(tried.returncode, 1)
            self.assertRegex(tried.stderr, f"ROS_DOMAIN_ID is '{domain}'.*Likely cause.*Next: ")

    def test_says_what_is_wrong_with_its_command_line(self):
        for words, said in (
            (["--lnk", "/dev/null"], "'--lnk' is not known to holdfast-ros2"),
            (["--link", "/dev/null", "--domain", "233"], "--domain"),
            (["--link", "/dev/null", "--mcap", __file__], "--mcap"),
            ([], "nothing to read"),
        ):
            tried = subprocess.run([BIN / "holdfast-ros2", *words], capture_output=True, text=True, timeout=60)
            self.assertEqual(tried.returncode, 1)
            self.assertRegex(tried.stderr, rf"\Aholdfast: .*{said}.*\. Likely cause: .*\. Next: .*\n\Z")

    def test_the_msg_files_are_the_schemas_of_the_logs(self):
        with tempfile.TemporaryDirectory() as work:
            replay = [BIN / "holdfast", "replay", SOURCE / "tests/data/slip.mjpg", "--mcap", f"{work}/mcap"]
            subprocess.run(replay, check=True, timeout=300, stdout=subprocess.DEVNULL)
            data = Path(work, "mcap").read_bytes()
        for name in OURS[:2]:
            self.assertIn((ROS2 / f"holdfast_msgs/msg/{name}.msg").read_bytes() + b"=" * 80 + b"\n", data)

    def test_the_idl_says_the_same(self):
        kinds = {
            "uint8": "octet",
            "bool": "boolean",
            "uint32": "unsigned long",
            "float64": "double",
            "string": "string",
        }
        kinds["std_msgs/Header"] = "std_msgs::msg::dds_::Header_"
        idl = (ROS2 / "holdfast.idl").read_text()
        for name in OURS:
            body = re.search(r"struct %s_ \{(.*?)\};" % name, idl, re.S)[1]
            got = [one.split() for one in body.replace("\n", " ").split(";") if one.strip()]
            want = []
            for line in lines_of((ROS2 / f"holdfast_msgs/msg/{name}.msg").read_text()):
                kind, array, field = re.match(r"([\w/]+)(\[\d*\])? (\w+)$", line).groups()
                kind = kinds[kind]
                kind = f"sequence<{kind}>" if array == "[]" else kind
                want.append((kind + " " + field + (array if array not in (None, "[]") else "")).split())
            self.assertEqual(got, want)

    def test_constants_are_those_of_the_link(self):
        text = (ROS2 / "holdfast_msgs/msg/Command.msg").read_text()
        constants = {name: int(number) for name, number in re.findall(r"^uint8 (\w+)=(\d+)", text, re.M)}
        self.assertEqual(constants, link.COMMANDS)

    @unittest.skipUnless(
        Path("/usr/share/ament_cmake").exists() and shutil.which("rosidl"), "no ament_cmake, no rosidl"
    )
    def test_the_ament_package_builds(self):
        """By Debian's ament_cmake and ROS 2's generators of C and C++. Debian has no std_msgs of ROS 2 and no
        rosidl_default_generators: stand-ins, with the two messages that ours need."""
        with tempfile.TemporaryDirectory() as work:
            generators = Path(work, "rosidl_default_generators")
            generators.mkdir()
            wanted = "\n".join(f"find_package({name} REQUIRED)" for name in GENERATORS)
            Path(generators, "rosidl_default_generatorsConfig.cmake").write_text(wanted)
            stand_in(work, "builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n", "")
            stand_in(
                work, "std_msgs", "Header", "builtin_interfaces/Time stamp\nstring frame_id\n", "builtin_interfaces"
            )
            shutil.copytree(ROS2 / "holdfast_msgs", Path(work, "holdfast_msgs"))
            environment = dict(os.environ, PATH="/usr/bin:" + os.environ["PATH"])
            places = [f"-DCMAKE_PREFIX_PATH={work}/here", f"-DCMAKE_INSTALL_PREFIX={work}/here"]
            places += [f"-Drosidl_default_generators_DIR={generators}", "-DPython3_EXECUTABLE=/usr/bin/python3"]
            names = ("builtin_interfaces", "std_msgs", "holdfast_msgs")
            for name in names:
                source, build = f"{work}/{name}", f"{work}/build/{name}"
                for words in (["-S", source, "-B", build, *places], ["--build", build], ["--install", build]):
                    self.run_or_fail(["cmake", *words], environment)
            Path(work, "use.cpp").write_text(USE)
            folders = [f"-I{work}/here/include/{name}" for name in names]
            folders += [
                f"-I/usr/include/{name}"
                for name in ("rosidl_runtime_cpp", "rosidl_runtime_c", "rosidl_typesupport_interface")
            ]
            self.run_or_fail(["g++", "-std=c++17", *folders, f"{work}/use.cpp", "-o", f"{work}/use"], environment)
            said = subprocess.run([f"{work}/use"], check=True, timeout=60, capture_output=True, text=True).stdout
            self.assertEqual(said.split(), ["holdfast_msgs/msg/SlipState", "15", "1"])

    def run_or_fail(self, command, environment):
        tried = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
        self.assertEqual(tried.returncode, 0, f"{command}:\n{tried.stdout[-2000:]}{tried.stderr[-2000:]}")


GENERATORS = ("rosidl_cmake", "rosidl_generator_c", "rosidl_generator_cpp")
USE = """
#include <holdfast_msgs/msg/command.hpp>
#include <holdfast_msgs/msg/slip_state.hpp>
#include <iostream>
int main() {
  holdfast_msgs::msg::SlipState state;
  state.header.stamp.sec = 1;
  state.evidence_unit = "um";
  std::cout << rosidl_generator_traits::name<holdfast_msgs::msg::SlipState>() << " " << state.histogram.size() << " "
            << int{holdfast_msgs::msg::Command::TARE};
}
"""


def stand_in(work, package, message, text, needs):
    folder = Path(work, package)
    Path(folder, "msg").mkdir(parents=True)
    Path(folder, "msg", f"{message}.msg").write_text(text)
    manifest = (ROS2 / "holdfast_msgs/package.xml").read_text().replace("holdfast_msgs", package)
    Path(folder, "package.xml").write_text(re.sub(r".*<(exec_)?depend>.*\n", "", manifest))
    build = (ROS2 / "holdfast_msgs/CMakeLists.txt").read_text().replace("project(holdfast_msgs)", f"project({package})")
    build = re.sub(
        r"msg/Answer.*DEPENDENCIES std_msgs", f"msg/{message}.msg" + (f" DEPENDENCIES {needs}" if needs else ""), build
    )
    build = build.replace("find_package(std_msgs REQUIRED)", f"find_package({needs} REQUIRED)" if needs else "")
    build = build.replace("ament_export_dependencies(rosidl_default_runtime)\n", "")
    Path(folder, "CMakeLists.txt").write_text(build)


if __name__ == "__main__":
    unittest.main()
