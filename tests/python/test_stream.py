"""Targets from Python over the command plugin stream."""

import json
import os
import socket
import subprocess
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

import viable
from support import expect_refusals
from viable import _stream

HOME = viable.Robot("indy7").home
STREAM = Path(os.environ["VIABLE_SOURCE_DIR"]) / "tools/python/examples/stream.yaml"


class Streams(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.name = f"test-{os.getpid()}-{self._testMethodName[-20:]}"

    def start(self, *arguments, command="live", space="joint", seconds=3):
        """The arm of stream.yaml, driven in a process of its own."""
        overrides = [f"command.name={self.name}", f"command.space={space}"]
        if space == "tool":
            overrides.append("controller.plugin=tool_servo")
        options = ["--duration", str(seconds)] if command == "live" else ["--set", f"duration_s={seconds}"]
        process = subprocess.Popen([viable.find_program(), command, STREAM, *options, "--no-report", "--out", self.folder / "run",
                                    *[part for each in overrides for part in ("--set", each)], *arguments],
                                   stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                   cwd=self.folder)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def send_while_it_runs(self, process, stream, make_target, rate=30):
        """Sends what make_target(k) gives, until the arm has ended."""
        k = 0
        try:
            while process.poll() is None:
                stream.send(make_target(k))
                k += 1
                time.sleep(1 / rate)
        except viable.Error as error:
            if "no arm listens" not in str(error):
                raise

    def log_of(self, process):
        self.assertEqual(process.wait(60), 0, process.stderr.read())
        return viable.Log(self.folder / "run/arm.mcap")

    def test_an_arm_follows_joint_targets_and_what_arrived_replays(self):
        process = self.start()
        sent = []

        def make_target(k):
            sent.append(HOME + 0.3 * np.sin(0.1 * k) * np.ones(6))
            return sent[-1]

        with viable.Stream(self.name) as stream:
            self.assertEqual((stream.space, len(stream.joints)), ("joint", 6))
            self.send_while_it_runs(process, stream, make_target)
            self.assertGreater(stream.counts["taken"], 20)
            self.assertLess(stream.age, 0.1)
        log = self.log_of(process)
        commands = log.joint_array("command", "q_rad")
        came = {tuple(row) for row in commands} - {tuple(HOME)}
        self.assertLessEqual(came, {tuple(row) for row in sent})  # each target to the last bit, and nothing else
        self.assertGreater(len(came), 20)
        self.assertGreater(np.ptp(log.joint_array("nominal", "q_rad")[:, 0]), 0.2)
        again = subprocess.run([viable.find_program(), "run", self.folder / "run/arm.mcap", "--again"], capture_output=True, text=True)
        self.assertEqual(again.returncode, 0, again.stdout + again.stderr)

    def test_without_fresh_targets_it_rests_at_the_last_one(self):
        process = self.start(seconds=4)
        with viable.Stream(self.name) as stream:
            while stream.counts["taken"] == 0:  # the first one that is said to be taken is followed
                stream.send(HOME + 0.1)
                time.sleep(1 / 30)
        log = self.log_of(process)
        np.testing.assert_array_equal(log.joint_array("command", "q_rad")[-1], HOME + 0.1)
        np.testing.assert_allclose(log.joint_array("nominal", "q_rad")[-1], HOME + 0.1, atol=1e-3)

    def test_tool_targets(self):
        pose = viable.Robot("indy7").dynamics(HOME).tool
        process = self.start(space="tool")
        with viable.Stream(self.name) as stream:
            self.assertEqual(stream.space, "tool")
            expect_refusals(self, (lambda: stream.send(np.zeros(6)), r"shape \(6,\).*shape \(4, 4\)"),
                            (lambda: stream.send(np.diag([2.0, 1, 1, 1])), "is no rotation"))
            turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
            goal = pose.copy()
            goal[:3, :3] = turn @ pose[:3, :3]
            goal[:3, 3] += [0, 0, -0.05]
            self.send_while_it_runs(process, stream, lambda k: goal)
        log = self.log_of(process)
        np.testing.assert_allclose(log["command.tool.z_m"][-1], goal[2, 3], atol=1e-12)
        np.testing.assert_allclose(log["nominal.tool.z_m"][-1], goal[2, 3], atol=0.01)

    def test_in_simulation_the_newest_counts_too(self):
        process = self.start(command="run", seconds=30)
        with viable.Stream(self.name) as stream:
            self.send_while_it_runs(process, stream, lambda k: HOME + 0.2, rate=100)
        commands = self.log_of(process).joint_array("command", "q_rad")
        np.testing.assert_array_equal(commands[-1], HOME + 0.2)

    def test_what_is_no_target_is_refused_before_it_is_sent(self):
        process = self.start(seconds=1)
        with viable.Stream(self.name) as stream:
            for target, text in ((np.zeros(5), r"shape \(5,\).*shape \(6,\)"), (np.zeros((6, 1)), r"shape \(6, 1\)"),
                                 (np.full(6, np.nan), "not finite"), ("x", "no array of numbers"), ([[1], 2, 3], "array of numbers"),
                                 (["0"] * 6, "no array of numbers"), (np.zeros(6, dtype=complex), "complex128.*no array of numbers"),
                                 ([None] * 6, "no array of numbers"), (np.zeros(6, dtype="m8[s]"), "no array of numbers")):
                expect_refusals(self, (lambda: stream.send(target), text))
            stream.send(np.zeros(6, dtype=np.float32))
            stream.send([0] * 6)
        commands = self.log_of(process).joint_array("command", "q_rad")
        self.assertLessEqual({tuple(row) for row in commands}, {tuple(HOME), (0.0,) * 6})

    def test_nobody_listens(self):
        begin = time.monotonic()
        with self.assertRaisesRegex(viable.Error, "no arm listens.*viable live FILE"):
            viable.Stream(self.name, timeout=0.3)
        self.assertLess(time.monotonic() - begin, 5)
        process = self.start(seconds=0.3)
        with viable.Stream(self.name) as stream:
            process.wait(60)
            with self.assertRaisesRegex(viable.Error, "no arm listens"):
                stream.send(np.zeros(6))

    def test_two_programs(self):
        process = self.start(seconds=2)
        with viable.Stream(self.name) as stream, viable.Stream(self.name) as other:
            with self.assertRaisesRegex(viable.Error, "another program sends"):
                def send_both(k):
                    if k > 0:
                        other.send(HOME + 1)
                    return HOME

                self.send_while_it_runs(process, stream, send_both)
            self.assertGreater(stream.counts["busy"] + other.counts["busy"], 0)
        commands = self.log_of(process).joint_array("command", "q_rad")
        changes = (np.diff(commands, axis=0) != 0).any(axis=1).sum()
        self.assertLessEqual(changes, 1)  # it does not go to and fro between them

    def test_one_after_the_other(self):
        process = self.start(seconds=3)
        with viable.Stream(self.name) as first:
            while first.counts["taken"] == 0:
                first.send(HOME + 0.1)
                time.sleep(1 / 30)
        with viable.Stream(self.name) as second:
            self.send_while_it_runs(process, second, lambda k: HOME + 0.2)
            self.assertEqual(second.counts["busy"], 0)
            self.assertGreater(second.counts["taken"], 0)
        second.close()  # again: nothing
        with self.assertRaisesRegex(viable.Error, "is closed"):
            second.send(HOME)
        commands = self.log_of(process).joint_array("command", "q_rad")
        np.testing.assert_array_equal(commands[-1], HOME + 0.2)

    def test_only_the_arm_can_answer(self):
        process = self.start(seconds=100)
        with viable.Stream(self.name) as stream, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as foreign:
            with self.assertRaises(OSError):
                foreign.sendto(bytes(24), stream._socket.getsockname())
        process.kill()

    def test_answers_are_to_what_was_sent(self):
        """An arm that answers anything: what is no answer to a message of this stream counts for nothing."""
        runtime = self.use_runtime_folder()
        folder = runtime / "viable"
        folder.mkdir(mode=0o700)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as arm:
            arm.bind(str(folder / f"{self.name}.socket"))
            arm.setblocking(False)
            (folder / f"{self.name}.json").write_text(json.dumps({"token": "00" * 16, "version": 1, "space": "joint", "joints": ["a"]}))
            with viable.Stream(self.name) as stream:
                def answer(verdict, sequence, version=1):
                    arm.sendto(_stream._ANSWER.pack(_stream._MAGIC, version, verdict, sequence, 0.5), client)

                stream.send([0.0])
                _, client = arm.recvfrom(1000)
                for verdict, sequence, version in ((0, 3, 1), (0, 0, 1), (3, 2**64 - 1, 1), (0, 1, 2), (8, 1, 1)):
                    answer(verdict, sequence, version)
                stream.send([0.0])
                self.assertEqual(sum(stream.counts.values()), 0)
                for _ in range(3):
                    answer(0, 2)
                stream.send([0.0])
                self.assertEqual(stream.counts["taken"], 1)
                self.assertEqual(stream.age, 0.5)

    def test_a_folder_that_others_can_enter_is_refused(self):
        runtime = self.use_runtime_folder()
        (runtime / "viable").mkdir()
        (runtime / "viable").chmod(0o755)
        with self.assertRaisesRegex(viable.Error, "no folder of this user alone.*chmod 700"):
            viable.Stream(self.name, timeout=0)
        (runtime / "viable").rmdir()
        (runtime / "viable").symlink_to("/")
        with self.assertRaisesRegex(viable.Error, "no folder of this user alone"):
            viable.Stream(self.name, timeout=0)

    def use_runtime_folder(self):
        self.enterContext(mock.patch.dict(os.environ, XDG_RUNTIME_DIR=str(self.folder)))
        return self.folder

    def test_two_arms_of_one_name(self):
        process = self.start(seconds=100)
        viable.Stream(self.name).close()
        with self.assertRaisesRegex(viable.Error, "another program of viable listens there.*another `name`"):
            viable.run(STREAM, set={"command.name": self.name, "duration_s": 0.1})
        process.kill()

    def test_late_targets_are_not_followed(self):
        process = self.start(seconds=1.5)
        with viable.Stream(self.name) as stream:
            real = _stream.time.monotonic_ns
            with mock.patch.object(_stream.time, "monotonic_ns", lambda: real() - 500_000_000):
                self.send_while_it_runs(process, stream, lambda k: HOME + 1)
            self.assertGreater(stream.counts["stale"], 0)
            self.assertEqual(stream.counts["taken"], 0)
        commands = self.log_of(process).joint_array("command", "q_rad")
        self.assertEqual({tuple(row) for row in commands}, {tuple(HOME)})

    def test_quaternions_are_those_of_the_rotations(self):
        rng = np.random.default_rng(5)
        for k in range(200):
            q = rng.normal(size=4)
            q = np.eye(4)[k % 4] + 1e-3 * q if k < 40 else q
            w, x, y, z = q / np.linalg.norm(q)
            r = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                          [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                          [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
            found = _stream._quaternion(r)
            self.assertAlmostEqual(abs(found @ [w, x, y, z]), 1.0, places=12)


if __name__ == "__main__":
    unittest.main()
