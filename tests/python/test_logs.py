# SPDX-License-Identifier: Apache-2.0
"""toolchain/python/holdfast/logs.py against files that the tool wrote; the oracles are the recording that it read, the
tool's own export and, for CSV, lines that are split by hand."""

import math
import os
import subprocess
import tempfile
import unittest
from pathlib import Path
from unittest import mock

from holdfast import logs

SOURCE = Path(__file__).resolve().parents[2]
BIN = Path(os.environ["HOLDFAST_BIN"])
CAMERA = SOURCE / "tests/data/slip.mjpg"
FRAMES = 16
NAMES = ("mcap", "log", "features", "markers")


def setUpModule():
    global work, run
    work = tempfile.TemporaryDirectory()
    run = {name: Path(work.name, name) for name in NAMES}
    wanted = [part for name in NAMES for part in (f"--{name}", run[name])]
    tool = [BIN / "holdfast", "replay", CAMERA, *wanted]
    subprocess.run(tool, check=True, timeout=300, stdout=subprocess.DEVNULL)
    export = [BIN / "holdfast", "log", "export", run["mcap"], "--csv", f"{work.name}/csv"]
    subprocess.run(export, check=True, timeout=300, stdout=subprocess.DEVNULL)


def tearDownModule():
    work.cleanup()


def plain(path):
    """Rows of a CSV file whose cells hold no comma."""
    head, *rows = Path(path).read_text().splitlines()
    return head.split(","), [row.split(",") for row in rows]


class Logs(unittest.TestCase):
    def test_every_cell_of_every_csv(self):
        for name in NAMES[1:]:
            head, rows = plain(run[name])
            columns = logs.read_csv(run[name])
            self.assertEqual(list(columns), head)
            for k, column in enumerate(head):
                self.assertEqual(len(columns[column]), len(rows))
                for cell, got in zip((row[k] for row in rows), columns[column]):
                    if not isinstance(got, str):
                        self.assertTrue(math.isnan(got) if cell == "" else float(cell) == got, (column, cell, got))
                    else:
                        self.assertEqual(cell, got)

    def test_the_states_of_the_mcap_are_those_that_the_tool_exports(self):
        head, rows = plain(f"{work.name}/csv")
        table = logs.Mcap(run["mcap"]).table("/holdfast/slip")
        self.assertEqual(len(rows), FRAMES)
        compared = 0
        for k, column in enumerate(head):
            if column in table:
                got = [float(value) for value in table[column]]
                for row, value in zip(rows, got, strict=True):
                    self.assertAlmostEqual(float(row[k]), value, delta=1e-6 * max(1, abs(value)))  # its digits
                compared += 1
        self.assertGreaterEqual(compared, 15)
        stamps = [s + n / 1e9 for s, n in zip(table["header.stamp.sec"], table["header.stamp.nanosec"])]
        for row, stamp, time_ns in zip(rows, stamps, table["time_ns"], strict=True):
            self.assertAlmostEqual(float(row[head.index("t_s")]), stamp, delta=1e-6)
            self.assertEqual(round(stamp * 1e9), time_ns)
        self.assertIn("SLIP", set(table["state_name"]))
        self.assertEqual({len(histogram) for histogram in table["histogram"]}, {15})

    def test_the_pictures_are_the_cameras_bytes(self):
        pictures = logs.Mcap(run["mcap"]).table("/holdfast/camera")["data"]
        self.assertEqual(b"".join(pictures), CAMERA.read_bytes())

    def test_the_markers_are_those_of_the_csv(self):
        head, rows = plain(run["markers"])
        want = {(int(f), int(r), int(c)): [float(x) for x in rest[1:]] for f, r, c, *rest in rows if rest[0] == "1"}
        got = {}
        for message in logs.Mcap(run["mcap"]).messages("/holdfast/markers"):
            field = message.values
            for k, valid in enumerate(field["valid"]):
                if valid:
                    place = int(field["frame"]), int(field["row"][k]), int(field["col"][k])
                    got[place] = [float(field[name][k]) for name in ("x_px", "y_px", "dx_px", "dy_px")]
        self.assertEqual(set(got), set(want))
        for place, values in want.items():
            for a, b in zip(values, got[place]):
                self.assertAlmostEqual(a, b, delta=1e-3)  # the CSV's digits

    def test_topics_and_metadata(self):
        log = logs.Mcap(run["mcap"])
        topics = log.topics()
        self.assertEqual(topics["/holdfast/slip"], "holdfast_msgs/msg/SlipState")
        self.assertEqual(topics["/holdfast/camera"], "sensor_msgs/msg/CompressedImage")
        self.assertIn("holdfast", log.metadata)
        told = {message.topic for message in log.messages()}
        self.assertEqual(told, set(topics))

    def test_without_numpy_the_same_values(self):
        with mock.patch.object(logs, "numpy", None):
            lists = logs.Mcap(run["mcap"]).table("/holdfast/slip")
            csv_lists = logs.read_csv(run["log"])
        self.assertIs(type(lists["entropy_nat"]), list)
        self.assertIs(type(csv_lists["t_s"]), list)
        for name, column in logs.Mcap(run["mcap"]).table("/holdfast/slip").items():
            self.assertEqual([list(row) for row in column] if name == "histogram" else list(column), lists[name])

    @unittest.skipIf(logs.numpy is None, "no numpy")
    def test_columns_are_arrays(self):
        table = logs.Mcap(run["mcap"]).table("/holdfast/slip")
        self.assertEqual(table["entropy_nat"].dtype, logs.numpy.float64)
        self.assertEqual(table["slip"].dtype, bool)
        self.assertEqual(table["histogram"].shape, (len(table["frame"]), 15))
        self.assertEqual(logs.read_csv(run["log"])["t_s"].dtype, logs.numpy.float64)

    def test_a_broken_file_is_an_error_and_gives_what_is_whole(self):
        whole = run["mcap"].read_bytes()
        broken = Path(work.name, "broken.mcap")
        most = 0
        for cut in [0, 1, 7, 8, 9, 17, 100, 1000] + [len(whole) * k // 13 for k in range(1, 13)]:
            broken.write_bytes(whole[:cut])
            got = 0
            with self.assertRaises(logs.LogError):
                for _ in logs.Mcap(broken).messages("/holdfast/slip"):
                    got += 1
            self.assertGreaterEqual(got, most)
            most = got
        self.assertGreater(most, FRAMES // 2)
        for at in range(1000, len(whole) - 5000, len(whole) // 9):  # in a chunk, of whose bytes each is summed
            broken.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
            with self.assertRaisesRegex(logs.LogError, "Likely cause: .* Next: "):
                list(logs.Mcap(broken).messages())


if __name__ == "__main__":
    unittest.main()
