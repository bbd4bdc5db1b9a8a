"""The example scripts, run."""

import csv
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import viable

SOURCE = Path(os.environ["VIABLE_SOURCE_DIR"])
HAS_MATPLOTLIB = importlib.util.find_spec("matplotlib") is not None


class Examples(unittest.TestCase):
    def run_script(self, name, *arguments):
        """What it prints; its picture must be there where matplotlib is."""
        ended = subprocess.run([sys.executable, "-B", SOURCE / "tools/python/examples" / f"{name}.py", *map(str, arguments)],
                               capture_output=True, text=True, cwd=self.folder)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        picture = self.folder / f"{name}.png"
        if f"{name}.png" in ended.stdout:
            self.assertEqual(picture.exists(), HAS_MATPLOTLIB)
            self.assertIn("wrote" if HAS_MATPLOTLIB else "apt-get install python3-matplotlib", ended.stdout)
        return ended.stdout

    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def test_compare_laws(self):
        text = self.run_script("compare_laws", SOURCE / "experiments/indy7_teleoperation.yaml", 5)
        jerks = [float(jerk) for jerk in re.findall(r"largest jerk +([\d.]+)", text)]
        self.assertEqual(len(jerks), 3)
        self.assertGreater(jerks[0], 10 * 37.7)
        self.assertAlmostEqual(jerks[2], 37.7, delta=0.05)
        self.assertRegex(text, "certified braking .*all limits kept")
        self.assertIn("compare_laws.png", text)

    def test_random_policy(self):
        text = self.run_script("random_policy", 64, 50)
        shares = [float(share) for share in re.findall(r"([\d.]+) %", text)]
        self.assertEqual(len(shares), 3)
        self.assertLessEqual(max(shares), 100.0)
        self.assertEqual(shares[2], 100.0)
        self.assertIn("random_policy.png", text)

    def test_identify_friction(self):
        """From a CSV as another program might write it."""
        viable.run(SOURCE / "experiments/indy7_teleoperation.yaml", cases="C3", out=self.folder / "run",
                   set={"duration_s": 8})
        log = viable.Log(self.folder / "run/C3.mcap")
        q, torque = log.joint_array("real", "q_rad"), log.joint_array("motor", "tau_Nm")
        with open(self.folder / "arm.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time_s", *(f"{joint}_rad" for joint in log.joints), *(f"{joint}_Nm" for joint in log.joints)])
            writer.writerows(np.column_stack([log["time_s"], q, torque]).tolist())
        text = self.run_script("identify_friction", "arm.csv", "indy7")
        found = dict(re.findall(r"(joint\d): Coulomb ([\d.]+) Nm", text))
        self.assertEqual(set(found), set(log.joints))
        for value, true in zip(found.values(), viable.Robot("indy7").friction["coulomb"]):
            self.assertAlmostEqual(float(value), true, delta=0.05 * true)
        self.assertIn("identify_friction.png", text)

    def test_try_law(self):
        text = self.run_script("try_law", 3)
        self.assertRegex(text, r"mine +[\d.]+ us in the filter")
        self.assertRegex(text, r"certified +[\d.]+ us in the filter +.*all limits kept")
        self.assertIn("try_law.png", text)

    def test_live_stream(self):
        text = self.run_script("live_stream", 4)
        taken = int(re.search(r"(\d+) targets taken", text).group(1))
        self.assertGreater(taken, 60)  # of 120: a busy machine may be late for some
        jerk, limit = map(float, re.search(r"largest jerk ([\d.]+) of ([\d.]+)", text).groups())
        self.assertLessEqual(jerk, limit)
        self.assertIn("live_stream.png", text)

    def test_overhead(self):
        rows = re.findall(r"^ +([\d.]+)  (.+)$", self.run_script("overhead"), re.MULTILINE)
        self.assertEqual(len(rows), 9)
        self.assertLess(float(rows[0][0]), float(rows[3][0]))  # a call alone is the least of it

    def test_throughput(self):
        rows = re.findall(r"^(\S.*?) {2,}(\d+) +([\d.]+) +([\d.]+) +(\d+) +(\d+) %$", self.run_script("throughput", 64, 0.05), re.MULTILINE)
        self.assertEqual(len(rows), 8)
        rates = {name: float(rate) for name, rate, *_ in rows}
        held = {name: float(share) for name, *_, share in rows}
        self.assertGreater(min(rates.values()), 100)
        self.assertGreater(rates["torque, nothing acts"], rates["torque, all joints limited"])
        self.assertGreater(rates["torque, all joints limited"], rates["torque, all limited, obstacles"])
        self.assertEqual(held["torque, nothing acts"], 0)
        self.assertGreater(held["torque, all joints limited"], 80)


if __name__ == "__main__":
    unittest.main()
