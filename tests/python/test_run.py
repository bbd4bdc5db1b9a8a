"""Runs, their logs and what is computed from them."""

import csv
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np

import viable
from support import EXPERIMENTS, expect_refusals
from viable import _paths

TELEOPERATION = EXPERIMENTS / "indy7_teleoperation.yaml"


class Runs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.out = cls.folder / "run"
        cls.progress = []
        cls.summary = viable.run(TELEOPERATION, set={"duration_s": 5}, cases=["C2", "C3"], out=cls.out,
                                 progress=cls.progress.append)

    def test_a_summary_is_that_of_the_program(self):
        written = json.loads((self.out / "summary.json").read_text())
        self.assertEqual(list(self.summary["cases"].values()), written["cases"])
        self.assertEqual(set(self.summary["cases"]), {"C2", "C3"})
        self.assertEqual((self.summary["exit_code"], self.summary["folder"]), (0, str(self.out)))
        self.assertTrue(self.summary["cases"]["C3"]["guarantees_limits"])
        for shares in self.progress:
            self.assertEqual(set(shares), {"C2", "C3"})
        self.assertEqual(self.progress[-1], {"C2": 1.0, "C3": 1.0})
        self.assertFalse((self.out / "report.html").exists())

    def test_nothing_is_kept_without_a_folder(self):
        before = set(os.listdir("."))
        summary = viable.run(TELEOPERATION, set={"duration_s": 0.1, "cases.C3.filter.gamma": np.float64(30)}, cases="C3")
        self.assertEqual(set(os.listdir(".")), before)
        self.assertIsNone(summary["folder"])
        self.assertEqual(set(summary["cases"]), {"C3"})

    def test_values_are_written_as_the_file_has_them(self):
        form = viable._program.format_value
        for value, text in ((True, "true"), (None, "null"), (2, "2"), (0.1, "0.1"), (float("inf"), ".inf"),
                            (-np.inf, "-.inf"), ([1, 2.5], "[1, 2.5]"), (np.array([[1, 2], [3, 4]]), "[[1, 2], [3, 4]]"),
                            ({"plugin": "nric", "k_r": [1, 2]}, "{plugin: nric, k_r: [1, 2]}"), ("2*pi", "2*pi"),
                            (np.float32(0.5), "0.5"), ("~uniform(0, 1)", '"~uniform(0, 1)"'), ("-(1 + 2) * pi", "-(1 + 2) * pi"),
                            (float("nan"), ".nan"), ("true", '"true"'), ("No", '"No"'), ("null", '"null"'), ("12", '"12"'),
                            ("-1.5e3", '"-1.5e3"'), ("0x1f", '"0x1f"'), (".inf", '".inf"'), ("", '""'), ("a: b", '"a: b"'),
                            (" a", '" a"'), ("#1", '"#1"'), ("Größe", '"Größe"'), (Path("/a b/é.yaml"), '"/a b/é.yaml"'),
                            (Path("logs/C3.mcap"), "logs/C3.mcap"), ("e", "e"), ("joint0", "joint0"),
                            ({"payload_kg": "~uniform(0, 1)"}, '{payload_kg: "~uniform(0, 1)"}')):
            self.assertEqual(form(value), text)
        summary = viable.run(TELEOPERATION, cases="C3", set={"duration_s": 0.1, "start": {"position_rad": viable.Robot("indy7").home},
                                                             "real_plant": {"plugin": "ideal"}})
        self.assertEqual(summary["cases"]["C3"]["real_plant"], "ideal")

    def test_a_text_arrives_as_it_is(self):
        for value, told in (("12", "quotes"), ("true", "true"), ("a: b # c", "a: b # c"), ("Größe", "Größe")):
            expect_refusals(self, (lambda: viable.run(TELEOPERATION, cases="C3", set={"duration_s": value}), told))
        summary = viable.run(TELEOPERATION, cases="C3", draw="1:0", set={"duration_s": "2 * 0.05", "real_plant": {
            "plugin": "simbody", "payload_kg": "~uniform(0, 1)"}, "robust_loop": {"plugin": "nric"}})
        self.assertEqual(summary["exit_code"], 0)

    def test_lines_that_are_no_messages_do_no_harm(self):
        parse = viable._program._parse
        error = {"kind": 2, "place": "a", "cause": "b", "remedy": ""}
        self.assertEqual(parse(json.dumps({"error": error})), {"error": error})
        self.assertEqual(parse('{"progress": {"C3": 0.5}}'), {"progress": {"C3": 0.5}})
        for line in ("{", "[1]", "word", '{"error": "text"}', '{"error": {"kind": 2}}', '{"progress": 3}', '{"progress": {"C3": "x"}}',
                     json.dumps({"error": {**error, "kind": "bad"}}), "{" * 100000, '{"a":' * 100000):
            self.assertEqual(parse(line), {}, line[:40])

    def test_tables_in_folders_of_any_name(self):
        folder = self.folder / "50 % #1?é"
        folder.mkdir()
        store = sqlite3.connect(str(folder / "sweep.sqlite"))
        store.execute("CREATE TABLE runs (run, case_name)")
        store.execute("INSERT INTO runs VALUES (0, 'C3')")
        store.commit()
        store.close()
        self.assertEqual(viable._program._read_table(folder), {"run": [0], "case_name": ["C3"]})

    def start_python(self, out):
        """A run that takes long, in a Python of its own; it has begun."""
        code = f"""
import viable
try:
    viable.run({str(TELEOPERATION)!r}, set={{"duration_s": 2000}}, cases="C3", out={str(out)!r},
               progress=lambda shares: print("running", flush=True))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        self.assertEqual(process.stdout.readline(), "running\n")
        return process

    def test_the_program_ends_with_a_python_that_is_killed(self):
        out = self.folder / "orphan"
        for ending in (signal.SIGTERM, signal.SIGKILL):
            with self.subTest(ending=ending):
                shutil.rmtree(out, ignore_errors=True)
                process = self.start_python(out)
                process.send_signal(ending)
                process.wait(10)
                process.stdout.close()
                end = time.monotonic() + 60
                while (out / "run.claim").exists() and time.monotonic() < end:
                    time.sleep(0.05)
                self.assertFalse((out / "run.claim").exists())
                self.assertTrue(viable.Log(out / "C3.mcap").complete)

    def test_errors_carry_place_cause_and_remedy(self):
        with self.assertRaises(viable.InputError) as caught:
            viable.run(TELEOPERATION, set={"tick_s": 2.0})
        error = caught.exception
        self.assertEqual((error.place, error.kind), ("--set tick_s", "bad_input"))
        self.assertIn("is out of range; allowed is [1e-05, 0.1]", error.cause)
        self.assertTrue(error.remedy)
        self.assertEqual(str(error), f"{error.place}: {error.cause}. {error.remedy}")
        with self.assertRaisesRegex(viable.Error, "no_such_file.yaml"):
            viable.run("no_such_file.yaml")
        expect_refusals(self, (lambda: viable.run(TELEOPERATION, cases="C33"), "Did you mean 'C3'|has no case of that name"),
                        (lambda: viable.run(TELEOPERATION, out=self.out), "already holds something"),
                        (lambda: viable.identify(self.out / "C3.mcap", payload="all"), "payload"))  # of the command line itself

    def test_what_progress_raises_ends_the_run(self):
        def progress(shares):
            raise ZeroDivisionError

        out = self.folder / "ended"
        with self.assertRaises(ZeroDivisionError):
            viable.run(TELEOPERATION, set={"duration_s": 2000}, cases="C3", out=out, progress=progress)
        self.assertTrue(viable.Log(out / "C3.mcap").complete)

    def test_an_interrupt_brakes_the_arm_and_finishes_the_log(self):
        out = self.folder / "interrupted"
        process = self.start_python(out)
        process.send_signal(signal.SIGINT)
        rest = process.communicate(timeout=60)[0]
        self.assertEqual(rest.splitlines()[-1], "interrupted")
        log = viable.Log(out / "C3.mcap")
        self.assertTrue(log.complete)
        # A row is the state at the beginning of its tick: one tick of jerk may be left.
        np.testing.assert_allclose(log.joint_array("nominal", "qd_radps")[-1], 0, atol=38 * 0.001**2)
        self.assertFalse((out / "run.claim").exists())

    def test_a_log_is_its_export(self):
        log = viable.Log(self.out / "C3.mcap")
        table = self.folder / "C3.csv"
        subprocess.run([_paths.find_program(), "export", self.out / "C3.mcap", "--to", "csv", table], check=True,
                       stdout=subprocess.DEVNULL)
        with open(table, newline="") as file:
            rows = list(csv.reader(file))
        self.assertEqual(rows[0], log.columns)
        self.assertEqual(len(rows) - 1, len(log))
        columns = log.read(log.columns)
        kinds = set()
        for i, name in enumerate(rows[0]):
            values = columns[name]
            texts = [row[i] for row in rows[1:]]
            kinds.add(values.dtype.kind)
            if values.dtype.kind == "U":
                self.assertEqual(list(values), texts, name)
            else:
                expected = np.array([float(text) if text else np.nan for text in texts])
                np.testing.assert_array_equal(values, expected, name)
        self.assertEqual(kinds, {"U", "i", "f"})

    def test_columns_are_read_when_asked_for_and_kept(self):
        log = viable.Log(self.out / "C3.mcap")
        self.assertEqual(log._read, {})
        time_s = log["time_s"]
        self.assertIs(log["time_s"], time_s)
        self.assertEqual(set(log._read), {"time_s"})
        self.assertFalse(time_s.flags.writeable)
        np.testing.assert_allclose(np.diff(time_s), 0.001, atol=1e-12)
        q = log.joint_array("nominal", "q_rad")
        self.assertEqual(q.shape, (5000, 6))
        np.testing.assert_array_equal(q[:, 2], log["nominal.joint2.q_rad"])
        self.assertEqual(log.joints, [f"joint{i}" for i in range(6)])
        self.assertIn(b"indy7", log.attachments["experiment.yaml"])
        self.assertEqual(log.metadata["case"], "C3")
        self.assertTrue(log.complete)
        self.assertIn("tick.status", log)
        expect_refusals(self, (lambda: log["time"], "no column 'time'. Did you mean 'time_s'"),
                        (lambda: viable.Log(self.folder / "nothing.mcap"), "nothing.mcap"))

    def test_a_log_that_was_cut_off_gives_what_it_has(self):
        whole = (self.out / "C3.mcap").read_bytes()
        cut = self.folder / "cut.mcap"
        cut.write_bytes(whole[: len(whole) // 2])
        log = viable.Log(cut)
        self.assertFalse(log.complete)
        self.assertTrue(1000 < len(log) < 4000)
        complete = viable.Log(self.out / "C3.mcap")
        np.testing.assert_array_equal(log["real.joint1.q_rad"], complete["real.joint1.q_rad"][: len(log)])
        cut.write_bytes(b"no log")
        with self.assertRaises(viable.InputError) as caught:
            viable.Log(cut)
        self.assertTrue(caught.exception.place.startswith(str(cut)))

    def test_pandas(self):
        try:
            import pandas
        except ImportError:
            self.skipTest("python3-pandas is not installed")
        frame = viable.Log(self.out / "C3.mcap").to_pandas(["time_s", "tick.status", "tick.missed"])
        self.assertIsInstance(frame, pandas.DataFrame)
        self.assertEqual((frame.shape, list(frame)), ((5000, 3), ["time_s", "tick.status", "tick.missed"]))

    def test_records_are_judged_and_identified(self):
        verdict = viable.verify(self.out / "C3.mcap", signal="nominal")
        self.assertEqual((verdict["outcome"], verdict["signal"]), ("held", "nominal"))
        viable.run(TELEOPERATION, set={"duration_s": 5}, cases="C1", out=self.folder / "C1")
        self.assertEqual(viable.verify(self.folder / "C1" / "C1.mcap", signal="nominal")["outcome"], "broken")
        found = viable.identify(self.out / "C3.mcap", payload="mass", out=self.folder / "actuation.yaml")
        self.assertTrue((self.folder / "actuation.yaml").exists())
        self.assertIn("joints", found)

    def test_bounds(self):
        file = EXPERIMENTS / "two_link_real_limits.yaml"
        bounds = viable.bound(file)
        narrower = viable.bound(file, set={"disturbance_set.payload_kg": 0})
        joint = bounds[0]["position_rad"]
        self.assertTrue(all(0 < each < 1 for each in joint))
        self.assertLess(narrower[0]["position_rad"][1], joint[1])

    def test_sweeps(self):
        out = self.folder / "sweep"
        table = viable.sweep(EXPERIMENTS / "indy7_sweep.yaml", runs=3, out=out, set={"duration_s": 1}, seed=5)
        self.assertEqual(sorted(set(table["run"])), [0, 1, 2])
        self.assertEqual(len(set(map(len, table.values()))), 1)
        payloads = dict(zip(table["run"], table["draw.real_plant.payload_kg"]))
        self.assertEqual(len(set(payloads.values())), 3)
        replay = viable.run(EXPERIMENTS / "indy7_sweep.yaml", draw="5:1", set={"duration_s": 1})
        name = table["case_name"][table["run"].index(1)]
        at = [i for i, run in enumerate(table["run"]) if run == 1 and table["case_name"][i] == name][0]
        self.assertEqual(replay["cases"][name]["tracking"]["rms_rad"], table["tracking.rms_rad"][at])


if __name__ == "__main__":
    unittest.main()
