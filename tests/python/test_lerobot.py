# SPDX-License-Identifier: Apache-2.0
"""toolchain/python/holdfast/lerobot.py: which frame a row stands for, and what is refused. That other readers
read what it writes is tests/npm/check_lerobot.mjs."""

import contextlib
import io
import json
import os
import subprocess
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from holdfast import lerobot, parquet
from holdfast.logs import LogError

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])


def frames(*times_ms):
    return [(time * 1_000_000, [float(time)], []) for time in times_ms]


def chosen(times_ms, fps):
    return [round(row[0] / 1e6) for row in lerobot.on_grid(frames(*times_ms), fps)]


class Grid(unittest.TestCase):
    def test_a_steady_camera(self):
        self.assertEqual(chosen([0, 40, 80, 120], 25), [0, 40, 80, 120])

    def test_jitter_below_half_a_period_loses_and_repeats_nothing(self):
        self.assertEqual(chosen([3, 59, 64, 140, 160], 25), [3, 59, 64, 140, 160])

    def test_a_gap_repeats_the_frame_before(self):
        self.assertEqual(chosen([0, 40, 200, 240], 25), [0, 40, 40, 40, 40, 200, 240])

    def test_a_clock_that_is_a_little_fast_skips_one_now_and_then(self):
        times = [39 * k for k in range(101)]
        rows = chosen(times, 25)
        self.assertEqual(len(rows), 98 + 1)
        # Never further than half a period from its own time.
        self.assertTrue(all(abs(time - 40 * k) <= 20 for k, time in enumerate(rows)))


class Parquet(unittest.TestCase):
    def test_what_it_cannot_write_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            for columns in (
                [("a", "int64", [1, 2]), ("b", "int64", [1])],
                [("a", "float32", [[1.0, 2.0], [1.0]])],
                [("a", "float32", [[1.0], [2.0]])],
            ):
                with self.assertRaises(ValueError):
                    parquet.write(f"{folder}/x", columns)
                self.assertEqual(os.listdir(folder), [])


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = tempfile.TemporaryDirectory()
        cls.log = cls.made("sphere_slip")

    @classmethod
    def tearDownClass(cls):
        cls.work.cleanup()

    @classmethod
    def made(cls, scene):
        path = Path(cls.work.name, f"{scene}.mcap")
        tool = [BIN / "holdfast", "sim", SOURCE / f"tests/scenes/{scene}.json", "--mcap", path]
        subprocess.run(tool, check=True, timeout=300, stdout=subprocess.DEVNULL)
        return path

    def refused(self, pattern, logs, **options):
        out = Path(self.work.name, "refused")
        with self.assertRaisesRegex(LogError, pattern):
            lerobot.export(str(out), logs, **options)
        self.assertFalse(out.exists())

    def test_a_folder_appears_whole(self):
        out = Path(self.work.name, "whole")
        count, repeated = lerobot.export(str(out), [self.log, self.log], task="lift")
        self.assertEqual(repeated, 0)
        info = json.loads((out / "meta/info.json").read_text())
        self.assertEqual((info["total_frames"], info["fps"], info["total_episodes"]), (count, 25, 2))
        names = sorted(path.name for path in (out / "data/chunk-000").iterdir())
        self.assertEqual(names, ["episode_000000.parquet", "episode_000001.parquet"])
        with self.assertRaisesRegex(LogError, "it is there already"):
            lerobot.export(str(out), [self.log])

    def test_what_is_refused(self):
        self.refused("25.0 frames per second, not 60", [self.log], fps=60)
        broken = Path(self.work.name, "broken.mcap")
        broken.write_bytes(Path(self.log).read_bytes()[: self.log.stat().st_size // 2])
        self.refused("broken|breaks off", [broken])
        self.refused("no MCAP file", [SOURCE / "tests/data/slip.mjpg"])
        two = [(0, [0.0, 0.0], [0.0, 0.0]), (40_000_000, [0.0, 0.0], [0.0, 0.0])]
        with mock.patch.object(lerobot, "read", side_effect=[(two, [(0, 0)]), (two, [(0, 1)])]):
            self.refused("another lattice", ["a", "b"])

    def test_what_lies_beside_it_stays(self):
        beside = Path(self.work.name, "beside")
        foreign = beside / "out.new" / "mine"
        foreign.parent.mkdir(parents=True)
        foreign.touch()
        with self.assertRaises(LogError):
            lerobot.export(f"{beside}/out/", [SOURCE / "tests/data/slip.mjpg"])
        self.assertEqual([path.name for path in beside.iterdir()], ["out.new"])
        lerobot.export(f"{beside}/out/", [self.log])
        self.assertEqual(sorted(path.name for path in beside.iterdir()), ["out", "out.new"])
        self.assertTrue(foreign.exists() and Path(beside, "out/meta/info.json").exists())

    def test_the_command(self):
        out = Path(self.work.name, "command")
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            lerobot.main([str(out), str(self.log)])
        self.assertRegex(said.getvalue(), r"written .*: 1 episodes, \d+ frames, 0 of them the frame before again")
        with self.assertRaisesRegex(SystemExit, "error: .*it is there already.*Next: "):
            lerobot.main([str(out), str(self.log)])


if __name__ == "__main__":
    unittest.main()
