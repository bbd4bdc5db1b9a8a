"""Many guarded arms at once."""

import gc
import os
import threading
import time
import unittest

import numpy as np

import viable
from support import EFFORT, assert_same, expect_refusals, find_largest, make_forms, read_limits, run_teleoperation

MOTION = ("q_rad", "qd_radps", "qdd_radps2", "jerk_radps3")


def find_excess(batch, limits):
    """By how much an arm is beyond a limit, relative to that; inf where a number is not finite."""
    return find_largest(((batch.q, limits.position), (batch.qd, limits.velocity), (batch.qdd, limits.acceleration),
                         (batch.jerk, limits.jerk)))


class Batches(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.robot = viable.Robot("indy7")

    def test_the_check_of_limits_sees_what_it_shall(self):
        values, limits = np.zeros((3, 2)), np.array([[-1.0, -np.inf], [2.0, np.inf]])
        self.assertEqual(find_largest([(values, limits)]), 0)
        for at, value, expected in (((1, 0), 2.2, 0.1), ((2, 0), -1.5, 0.5), ((0, 1), 1e9, 0), ((1, 0), np.nan, np.inf),
                                    ((2, 1), np.nan, np.inf), ((2, 1), np.inf, np.inf)):
            broken = values.copy()
            broken[at] = value
            self.assertAlmostEqual(find_largest([(values, limits), (broken, limits)]), expected)

    def test_limits_hold_under_a_random_policy(self):
        rng = np.random.default_rng(1)
        for action, size in (("torque", 300), ("acceleration", 40), ("target", 4), ("tool_pose", 1), ("tool_position", 1)):
            batch = viable.Batch(self.robot, 256, action=action)
            batch.random_reset(rng, share=1.0)
            begin = batch.q.copy()
            seen = set()
            for step in range(max(400, int(400 * EFFORT))):
                if step % 8 == 0:
                    actions = rng.uniform(-size, size, (256, batch.action_size))
                    if action == "tool_pose":
                        actions[:, 3:] /= np.linalg.norm(actions[:, 3:], axis=1, keepdims=True)
                batch.step(actions, substeps=1)
                self.assertLess(find_excess(batch, self.robot.limits), 1e-9, action)
                self.assertTrue((batch.margin > -1e-9).all())
                seen |= set(np.unique(batch.acting))
            self.assertGreater(abs(batch.q - begin).max(), 0.2)
            self.assertTrue(np.isin(batch.status, [1, 2]).all())
            if action == "torque":
                self.assertTrue({1, -1, 4, -4} <= seen, seen)

    def test_bit_equal_to_the_program(self):
        settings = {"duration_s": 3, "robust_loop": {"plugin": "nric"},
                    "real_plant": {"plugin": "simbody", "dynamics": "recursion", "payload_kg": 1.0, "seed": 7}}
        log = run_teleoperation(self, "C3", settings)
        nominal = [log.joint_array("nominal", name) for name in MOTION]
        wanted, filtered, motor = (log.joint_array(group, "tau_Nm") for group in ("desired", "filter", "motor"))
        real = [log.joint_array("real", name) for name in MOTION[:2]]
        status = log["tick.status"]
        batch = viable.Batch(self.robot, 3, limits=read_limits(log), k_alpha=5, gamma=20,
                             plant={"payload_kg": 1.0, "seed": 7})
        batch.reset(q=nominal[0][0])
        self.assertGreater(np.count_nonzero(status == "modified"), 1000)
        for i in range(len(wanted)):
            state = batch.q[2], batch.qd[2], batch.qdd[2], batch.real_q[2], batch.real_qd[2]
            assert_same(state, [values[i] for values in nominal[:3] + real], f"tick {i}")
            batch.step(np.tile(wanted[i], (3, 1)), 1)
            assert_same((batch.jerk[2], batch.torque[2], batch.motor_torque[2]), (nominal[3][i], filtered[i], motor[i]), f"tick {i}")
            self.assertEqual(batch.status[2], viable.STATUS.index({"passed": "passed", "modified": "limited"}[status[i]]))

    def test_tools_bit_equal_to_the_program(self):
        """tool_servo behind certified_braking, and behind whole_arm_braking beside obstacles."""
        around = {"safety_distance_m": 0.03, "obstacles": {"ball": {"sphere": 0.1, "at": {"xyz": [0.45, 0.25, 0.6]}},
                                                           "floor": {"half_space": {"normal": [0, 0, 1], "offset": 0.0}}}}
        for environment in (None, around):
            settings = {"duration_s": 3 if environment is None else 1.5}
            if environment is not None:
                settings["environment"] = environment
                settings["cases.C4.filter"] = {"plugin": "whole_arm_braking"}
            log = run_teleoperation(self, "C4", settings)
            nominal = [log.joint_array("nominal", name) for name in MOTION]
            filtered = log.joint_array("filter", "tau_Nm")
            poses = np.column_stack([log[f"command.tool.{name}"] for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")])
            clearance = None if environment is None else log["clearance.distance_m"]
            batch = viable.Batch(self.robot, 2, limits=read_limits(log), action="tool_pose", environment=environment)
            batch.reset(q=nominal[0][0])
            self.assertGreater(abs(nominal[0][-1] - nominal[0][0]).max(), 0.05)
            for i in range(len(poses)):
                assert_same((batch.q[1], batch.qd[1], batch.qdd[1]), [values[i] for values in nominal[:3]], f"tick {i}")
                batch.step(np.tile(poses[i], (2, 1)), 1)
                assert_same((batch.jerk[1], batch.torque[1]), (nominal[3][i], filtered[i]), f"tick {i}")
                if clearance is not None:
                    self.assertEqual(batch.clearance[1], clearance[i], f"tick {i}")

    def test_tool_actions_of_any_kind_give_the_same(self):
        for action in ("tool_pose", "tool_position"):
            batch = viable.Batch(self.robot, 8, action=action)
            self.assertEqual(batch.action_size, {"tool_pose": 7, "tool_position": 3}[action])
            actions = (batch.tool_pose() if action == "tool_pose" else batch.tool_position()).astype(np.float32)
            actions[:, 0] -= np.linspace(0, 0.2, 8, dtype=np.float32)
            expected = None
            for given in make_forms(actions):
                batch.reset()
                batch.step(given, 300)
                expected = batch.q.copy() if expected is None else expected
                np.testing.assert_array_equal(batch.q, expected)
            self.assertGreater(abs(expected[7] - expected[0]).max(), 0.1)
            expect_refusals(self, (lambda: batch.step(np.zeros((8, 6))), r"the array has shape \(8, 6\)"),
                            (lambda: batch.step(np.zeros((7, batch.action_size))), "Give a row of "),
                            (lambda: batch.step(np.zeros(batch.action_size)), "the array has shape"),
                            (lambda: batch.step(np.zeros((8, 6))), r"position and quaternion x, y, z, w per arm, shape \(8, 7\)"
                             if action == "tool_pose" else r"Give a row of x, y, z per arm, shape \(8, 3\)"),
                            (lambda: batch.step(actions.astype(complex)), "the array's type is complex128"))
            np.testing.assert_array_equal(batch.q, expected)
            broken = actions.astype(float)
            broken[2, 1] = np.nan
            broken[3] = np.inf
            batch.step(broken, 400)
            np.testing.assert_array_equal(np.flatnonzero(batch.status == viable.STATUS.index("waiting")), [2, 3])
            np.testing.assert_allclose(batch.qd[2:4], 0, atol=1e-9)

    def test_tools(self):
        batch = viable.Batch(self.robot, 3)
        batch.random_reset(np.random.default_rng(1))
        poses = batch.tool_pose()
        np.testing.assert_array_equal(poses[:, :3], batch.tool_position())
        for pose, q in zip(poses, batch.q):
            x, y, z, w = pose[3:]
            R = self.robot.dynamics(q).tool[:3, :3]
            np.testing.assert_allclose(R[:, 0], [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], atol=1e-12)
        expect_refusals(self, (lambda: batch.tool_pose(real=True), "there are no real arms"),
                        (lambda: batch.tool_position(real=True), "there are no real arms"))

    def test_arms_keep_clear(self):
        around = {"safety_distance_m": 0.03, "obstacles": {"ball": {"sphere": 0.15, "at": {"xyz": [0.3, 0.4, 0.6]}}}}
        results = []
        for threads in (1, 3):
            rng = np.random.default_rng(2)
            batch = viable.Batch(viable.Robot("panda"), 4, environment=around, threads=threads)
            self.assertEqual((batch.clearance.shape, batch.clearance.flags.writeable), ((4,), False))
            self.assertTrue(np.isnan(batch.clearance).all())
            batch.random_reset(rng)
            for _ in range(40):
                batch.step(rng.uniform(-60, 60, (4, 7)), 10)
                self.assertTrue((batch.clearance > 0.03 - 1e-6).all())
            results.append([batch.q.copy(), batch.clearance.copy(), batch.acting.copy()])
        assert_same(*results)
        batch = viable.Batch(self.robot, 2)
        batch.step(np.zeros((2, 6)))
        self.assertTrue(np.isnan(batch.clearance).all())
        for environment, cause in (({"obstacles": {"x": {"sphere": -1, "at": {"xyz": [1, 1, 1]}}}}, "Batch: environment.*sphere"),
                                   ({"walls": {}}, "walls"),
                                   ({"obstacles": {"ball": {"sphere": 3, "at": {"xyz": [0, 0, 0.5]}}}}, "arm 0.*from ball")):
            expect_refusals(self, (lambda: viable.Batch(self.robot, 1, environment=environment), cause))
        alone = viable.Batch(self.robot, 1, environment={})  # of itself
        alone.step(np.zeros((1, 6)), 1)
        self.assertGreater(alone.clearance[0], 0.0)
        covered = viable.Batch(self.robot, 1, environment={"obstacles": {"ball": {"sphere": 0.3, "at": {"xyz": [3, 0, 0]}}}})
        self.assertEqual(covered.random_poses(rng, []).shape, (0, 6))

    def test_a_guard_gives_the_same(self):
        rng = np.random.default_rng(2)
        batch = viable.Batch(self.robot, 4)
        guards = [viable.Guard(self.robot, robust_loop=False) for _ in range(4)]
        for guard in guards:
            guard.start(self.robot.home)
        for _ in range(20):
            actions = rng.uniform(-200, 200, (4, 6))
            batch.step(actions)
            for i, guard in enumerate(guards):
                for _ in range(10):
                    q, qd, _ = guard.nominal
                    guard.step(q, qd, actions[i])
                np.testing.assert_array_equal(guard.nominal, [batch.q[i], batch.qd[i], batch.qdd[i]])

    def test_threads_change_nothing(self):
        results = []
        for threads in (1, 2, 5):
            rng = np.random.default_rng(3)
            batch = viable.Batch(self.robot, 333, threads=threads, plant={"payload_kg": "~uniform(0, 2)"})
            for _ in range(10):
                batch.step(rng.uniform(-200, 200, (333, 6)), 7)
            results.append([np.array(values) for values in (batch.q, batch.qdd, batch.margin, batch.acting, batch.real_q)])
        for result in results[1:]:
            assert_same(result, results[0])

    def test_views(self):
        batch = viable.Batch(self.robot, 8)
        q = batch.q
        self.assertEqual((q.shape, q.dtype, q.flags.c_contiguous, q.flags.writeable), ((8, 6), np.float64, True, False))
        self.assertEqual((batch.acting.dtype, batch.status.dtype, batch.status.shape), (np.int8, np.uint8, (8,)))
        self.assertTrue(np.shares_memory(q, batch.q))
        before = q.copy()
        batch.step(np.full((8, 6), 100.0))
        self.assertFalse(np.array_equal(q, before))
        with self.assertRaises(ValueError):
            q[0, 0] = 1
        expected = q.copy()
        del batch
        gc.collect()
        np.testing.assert_array_equal(q, expected)  # the view keeps the batch
        self.assertIsNone(viable.Batch(self.robot, 1).real_q)
        self.assertEqual(np.from_dlpack(expected).shape, (8, 6))

    def test_actions_of_any_kind_give_the_same(self):
        actions = np.linspace(-100, 100, 48, dtype=np.float32).reshape(8, 6)
        expected = None
        for given in make_forms(actions):
            batch = viable.Batch(self.robot, 8)
            batch.step(given)
            expected = batch.q.copy() if expected is None else expected
            np.testing.assert_array_equal(batch.q, expected)

    def test_an_action_that_is_no_number_brakes_its_arm_alone(self):
        batch, other = viable.Batch(self.robot, 3), viable.Batch(self.robot, 3)
        actions = np.full((3, 6), 50.0)
        for each in (batch, other):
            each.step(actions, 100)
        broken = actions.copy()
        broken[1, 2] = np.nan
        for _ in range(10):
            batch.step(broken, 100)
            other.step(actions, 100)
        self.assertEqual(viable.STATUS[batch.status[1]], "waiting")
        np.testing.assert_allclose(batch.qd[1], 0, atol=1e-9)
        np.testing.assert_array_equal(batch.q[[0, 2]], other.q[[0, 2]])

    def test_what_does_not_fit_is_told(self):
        batch = viable.Batch(self.robot, 4)
        before = batch.q.copy()
        zero = np.zeros((4, 6))
        expect_refusals(
            self,
            (lambda: batch.step(np.zeros((6, 4))), r"shape \(6, 4\). Give a row of joints per arm, shape \(4, 6\)"),
            (lambda: batch.step(np.zeros(6)), r"shape \(6,\)"),
            (lambda: batch.step(zero + 1j), "type is complex128"),
            (lambda: batch.step(zero, 0), "0 ticks"),
            (lambda: batch.reset([4]), "there is no arm 4"),
            (lambda: batch.reset([-1]), "there is no arm -1"),
            (lambda: batch.reset([True, False]), r"shape \(2,\) and type bool"),
            (lambda: batch.reset([0, 1], np.zeros((3, 6))), "2 arms that are reset"),
            (lambda: batch.reset([0, 2], np.array([self.robot.home, self.robot.home + 5])),
             "arm 2: .*outside its limits: position"),
            (lambda: batch.reset([0, 1, 1, 0]), "arm 0 is named more than once. .*pass booleans"),
            (lambda: batch.random_reset(np.random.default_rng(1), np.array([1, 0, 0, 1])), "pass booleans"),
            (lambda: batch.random_reset(np.random.default_rng(1), [True]), r"shape \(1,\) and type bool"),
            (lambda: batch.random_reset(np.random.default_rng(1), [-1]), "there is no arm -1"),
            (lambda: batch.change_limits([self.robot.limits.replace(velocity=0.5)] * 3 + [None]), "entry 3 is None"),
            (lambda: batch.change_limits([self.robot.limits.replace(velocity=0.5)] * 3 + [viable.Limits(joints=6)]), "arm 3"),
            (lambda: batch.reset(q=np.full(6, np.nan)), "arm 0: its start is of the wrong size or not finite"),
            (lambda: batch.change_limits(None), "None are no limits"),
            (lambda: batch.change_limits([self.robot.limits]), "1 limits for 4 arms"),
            (lambda: batch.limits(4), "there is no arm 4"),
            (lambda: viable.Batch(self.robot, 0), "0 arms"),
            (lambda: viable.Batch(self.robot, 1, action="force"), "action: `force` is not one of the choices"),
            (lambda: viable.Batch(self.robot, 1, plant={"payload": 1}), "payload"),
            *((lambda plant=plant: viable.Batch(self.robot, 1, plant=plant), "Batch: plant: must be a map")
              for plant in (5, "simbody", "{plugin: simbody}", ["plugin"])),
            (lambda: viable.Batch(self.robot, 1, plant={"payload_kg": "~uniform(2)"}), "uniform"))
        np.testing.assert_array_equal(batch.q, before)
        for arm in range(4):  # of lists that were refused, none was put
            self.assertEqual(batch.limits(arm), self.robot.limits)

    def test_margins_are_of_the_limits_in_force(self):
        batch = viable.Batch(self.robot, 2)
        lower, upper = self.robot.limits.position
        home = self.robot.home
        batch.change_limits(self.robot.limits.replace(position=(lower, (home + upper) / 2)), [1])
        np.testing.assert_allclose(batch.margin[1], np.minimum((upper - home) / 2, home - lower), atol=1e-4)
        np.testing.assert_allclose(batch.margin[0], np.minimum(upper - home, home - lower), atol=1e-4)

    def test_resets_and_limits_of_single_arms(self):
        batch = viable.Batch(self.robot, 5, action="target")
        home = self.robot.home
        batch.reset(np.array([False, True, False, True, False]), home + 0.1)
        np.testing.assert_array_equal(batch.q[[1, 3]], [home + 0.1] * 2)
        np.testing.assert_array_equal(batch.q[[0, 2, 4]], [home] * 3)
        rows = home + np.arange(5)[:, None] * 0.01
        batch.reset([4, 0], rows)  # those of the arms
        np.testing.assert_array_equal(batch.q[[0, 4]], rows[[0, 4]])
        batch.reset([4, 0], rows[:2])  # those given
        np.testing.assert_array_equal(batch.q[[4, 0]], rows[:2])
        batch.reset([])
        batch.random_reset(np.random.default_rng(4), [2])
        self.assertGreater(abs(batch.q[2] - home).max(), 0.01)
        batch.reset()
        slow = self.robot.limits.replace(velocity=0.1)
        batch.change_limits(slow, [2])
        batch.change_limits([self.robot.limits.replace(velocity=0.2)], mask=[3])
        self.assertEqual(batch.limits(2), slow)
        fastest = np.zeros(5)
        for _ in range(100):
            batch.step(np.full((5, 6), 3.0))
            fastest = np.maximum(fastest, abs(batch.qd).max(axis=1))
        np.testing.assert_allclose(fastest[2:4], [0.1, 0.2], rtol=1e-6)
        self.assertTrue((fastest[[0, 1, 4]] > 0.5).all())
        np.testing.assert_allclose(batch.tool_position()[3], self.robot.dynamics(batch.q[3]).tool[:3, 3])

    def test_plants_are_drawn_and_follow(self):
        plant = {"payload_kg": "~uniform(0, 2)", "friction_scale": "~uniform(0.5, 1.5)"}
        batch = viable.Batch(self.robot, 30, plant=plant, seed=5)
        again = viable.Batch(self.robot, 30, plant=plant, seed=5)
        other = viable.Batch(self.robot, 30, plant=plant, seed=6)
        payloads = np.array(batch.draws["real_plant.payload_kg"], float)
        self.assertEqual(len(set(payloads)), 30)
        self.assertTrue(((0 <= payloads) & (payloads <= 2)).all())
        self.assertEqual(batch.draws, again.draws)
        self.assertNotEqual(batch.draws, other.draws)
        rng = np.random.default_rng(6)
        for _ in range(50):
            batch.step(rng.uniform(-150, 150, (30, 6)))
        deviation = abs(batch.q - batch.real_q).max()
        self.assertTrue(1e-5 < deviation < 0.05, deviation)

    def test_the_interpreter_runs_on_meanwhile_and_a_batch_is_stepped_once_at_a_time(self):
        batch = viable.Batch(self.robot, 500)
        actions = np.full((500, 6), 100.0)
        done = threading.Event()

        def work():
            while not done.is_set():
                try:
                    batch.step(actions, 100)
                except viable.InputError:  # it is the other one's turn
                    pass

        thread = threading.Thread(target=work)
        thread.start()
        message = ""
        try:
            end = time.monotonic() + 60
            while not message and time.monotonic() < end:  # in vain if step() held the interpreter's lock
                time.sleep(0.001)
                try:
                    batch.step(actions, 1)
                except viable.InputError as error:
                    message = str(error)
        finally:
            done.set()
            thread.join()
        self.assertIn("Batch.step: it was called while it was at work", message)

    def test_a_fork_steps_on(self):
        batch = viable.Batch(self.robot, 100, threads=2)
        actions = np.full((100, 6), 100.0)
        batch.step(actions)
        child = os.fork()
        if child == 0:
            batch.step(actions)
            os._exit(0 if np.isfinite(batch.q).all() and abs(batch.qd).max() > 0 else 1)
        self.assertEqual(os.waitpid(child, 0)[1], 0)


if __name__ == "__main__":
    unittest.main()
