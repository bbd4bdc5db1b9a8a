"""Robots without masses (`dynamics: none`): what is kept of them, and what refuses them."""

import json
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np

import viable
from support import EFFORT, find_largest

PROGRAM = Path(os.environ["PYTHONPATH"]).parent / "bin" / "viable"


def make_urdf(rng, joints):
    """An arm of capsules, without a mass; sometimes with one that no body has."""
    text = '<robot name="arm"><link name="l0"/>'
    for i in range(joints):
        axis, length = rng.normal(size=3), rng.uniform(0.15, 0.4)
        reach = rng.uniform(1, 3)
        body = '<inertial><mass value="-1"/><inertia ixx="1" ixy="0" ixz="0" iyy="9" iyz="0" izz="1"/></inertial>' if rng.random() < 0.2 else ""
        text += (f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
                 f'<origin xyz="0 0 {length}" rpy="{rng.uniform(-1, 1)} 0 0"/><axis xyz="{" ".join(map(str, axis))}"/>'
                 f'<limit lower="{-reach}" upper="{rng.uniform(1, 3)}" effort="0" velocity="{rng.uniform(0.5, 3)}"/></joint>'
                 f'<link name="l{i + 1}">{body}<collision><origin xyz="0 0 {length / 2}"/><geometry><cylinder radius="0.03" length="{length}"/>'
                 "</geometry></collision></link>")
    return text + "</robot>"


class WithoutMasses(unittest.TestCase):
    def setUp(self):
        self.out = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def call(self, *command):
        done = subprocess.run([PROGRAM, *map(str, command)], capture_output=True, text=True, timeout=300)
        return done.returncode, done.stdout, " ".join(done.stderr.split())

    def make(self, seed, joints):
        name = f"arm_{seed}"
        (self.out / f"{name}.urdf").write_text(make_urdf(np.random.default_rng(seed), joints))
        code, _, said = self.call("new", "robot", name, "--urdf", self.out / f"{name}.urdf", "--assume", "--without-masses", "--out", self.out)
        self.assertEqual(code, 0, said)
        self.assertNotIn("mass", " ".join(viable.Robot(self.out / name).assumed))
        return self.out / name

    def test_a_reference_guard_keeps_the_limits_of_random_arms(self):
        for seed in range(int(20 * max(EFFORT, 0.2))):
            rng = np.random.default_rng(100 + seed)
            robot = viable.Robot(self.make(seed, 2 + seed % 6))
            guard, limits, tick = viable.ReferenceGuard(robot, tick=0.001), robot.limits, 0.001
            guard.start(robot.home)
            states = [guard.step(rng.uniform(-4, 4, len(robot)) if k % 150 == 0 else None) for k in range(3000)]
            q, qd, qdd = (np.array([getattr(state, name) for state in states]) for name in ("q", "qd", "qdd"))
            jerk = np.diff(qdd, axis=0) / tick
            pairs = ((q, limits.position), (qd, limits.velocity), (qdd, limits.acceleration))
            self.assertLess(find_largest(pairs), 1e-10)
            self.assertLess(find_largest([(jerk, limits.jerk)]), 1e-9)  # a difference of accelerations
            self.assertGreater(abs(qd / limits.velocity[1]).max(), 0.5)

    def test_obstacles_are_kept_clear_of(self):
        folder = self.make(3, 6)
        code, _, said = self.call("run", folder / "obstacles.yaml", "--set", "duration_s=6", "--out", self.out / "run")
        self.assertEqual(code, 0, said)
        cases = {case["name"]: case for case in json.loads((self.out / "run/summary.json").read_text())["cases"]}
        self.assertIn("no collision", cases["whole_arm"]["verdict"])
        self.assertTrue((self.out / "run/report.html").exists())
        _, text, said = self.call("verify", self.out / "run/whole_arm.mcap", "--limits", folder, "--signal", "nominal")
        self.assertIn(" 0 broken", text, said)

    def test_what_needs_torques_is_refused(self):
        folder = self.make(5, 6)
        robot = viable.Robot(folder)
        n, zero = len(robot), np.zeros(len(robot))
        dynamics = robot.dynamics(zero)
        self.assertTrue(np.isnan(dynamics.M).all() and np.isnan(dynamics.b).all() and np.isfinite(dynamics.J).all())
        for call in (lambda: viable.Guard(robot), lambda: robot.gains(0.001), lambda: robot.forward_dynamics(zero, zero, zero),
                     lambda: viable.Batch(robot, n=2), lambda: robot.with_payload(1.0),
                     lambda: viable.Batch(robot, n=2, action="target", plant={"payload_kg": 1})):
            with self.assertRaisesRegex(viable.InputError, "has no masses .*needs them.*ReferenceGuard"):
                call()
        batch = viable.Batch(robot, n=2, action="target")
        batch.step(np.tile(robot.home + 0.1, (2, 1)))
        hand = (folder / "hand.yaml").read_text().replace("robot: arm_5", f"robot: {folder}")
        real = "real_plant: {{plugin: {}}}\nrobust_loop: {{plugin: {}}}\n"
        people = ("environment: {{people: {{ann: {{capsules: [{{from_m: [3, 3, 0], to_m: [3, 3, 2], radius_m: 0.2}}],"
                  " walk: [{{time_s: 0, xyz: [3, 3, 0]}}], latency_s: 0.05, error_m: 0.02, {}}}}}}}\n")
        filters = "filter: {plugin: certified_braking}"
        files = {
            hand + real.format("link", "none, accept_unstable: true"): "a real arm that takes torques needs them",
            hand + real.format("ideal", "nric"): "a real arm that takes torques needs them",
            hand.replace(filters, "filter: {plugin: whole_arm_braking, torque_share: 0.9}"): "a limit of the torque needs them",
            hand.replace(filters, "filter: {plugin: whole_arm_braking, torque_rate_Nmps: 100}"): "a limit of the torque needs them",
            "\n".join(line for line in hand.splitlines() if not line.startswith("environment")) + "\n" + people.format("body_part: hand"): "contact_speed_mps.* needs them",
        }
        for text, cause in files.items():
            (self.out / "bad.yaml").write_text(text)
            code, _, said = self.call("run", self.out / "bad.yaml", "--out", self.out / "none")
            self.assertEqual(code, 2, said)
            self.assertRegex(said, "bad.yaml:[0-9]+:[0-9]+.*has no masses .*" + cause)
            self.assertFalse((self.out / "none").exists())
        self.assertRegex(self.call("gains", folder)[2], "the robust loop needs them")
        (folder / "actuation.yaml").write_text("schema: 1\ndynamics: full\n")
        self.assertRegex(self.call("robots", "--describe", folder)[2], "actuation.yaml:2:.*none")


if __name__ == "__main__":
    unittest.main()
