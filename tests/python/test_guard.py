"""Guards, called from Python."""

import gc
import os
import pickle
import subprocess
import sys
import threading
import unittest
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import viable
from support import expect_refusals, find_largest, read_limits, run_teleoperation


def spring(q, qd, dynamics):
    """Towards a place far beyond all limits."""
    return dynamics.M @ (100.0 * (5.0 - q) - 20.0 * qd) + dynamics.b


def follow(guard, law, ticks):
    """A real arm that is the nominal one. Returns the nominal states (ticks, 3, n)."""
    states = []
    for _ in range(ticks):
        q, qd, _ = guard.nominal
        guard.step(q, qd, law)
        states.append(guard.nominal)
    return np.array(states)


def largest_excess(states, jerk, limits):
    """By how much states (ticks, 3, n) and jerks (ticks, n) pass their limits, relative to those; inf where one is not finite."""
    return find_largest(((states[:, 0], limits.position), (states[:, 1], limits.velocity),
                         (states[:, 2], limits.acceleration), (jerk, limits.jerk)))


class Guards(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.robot = viable.Robot("indy7")

    def make(self, **options):
        guard = viable.Guard(self.robot, 0.001, **options)
        guard.start(self.robot.home)
        return guard

    def test_the_check_of_limits_sees_what_it_shall(self):
        limits = viable.Limits(velocity=[2.0, np.inf], jerk=10.0)
        states, jerk = np.zeros((4, 3, 2)), np.zeros((4, 2))
        self.assertEqual(largest_excess(states, jerk, limits), 0)
        for at, value, expected in (((1, 1, 0), -2.2, 0.1), ((3, 1, 1), 1e9, 0), ((2, 0, 1), np.nan, np.inf), ((0, 2, 0), np.inf, np.inf)):
            broken = states.copy()
            broken[at] = value
            self.assertAlmostEqual(largest_excess(broken, jerk, limits), expected)
        jerk[2, 1] = 15
        self.assertAlmostEqual(largest_excess(states, jerk, limits), 0.5)

    def test_gains_are_of_arguments_that_can_be(self):
        unlimited = viable.Limits(joints=6)
        upside_down = viable.Limits(position=(1.0, -1.0), joints=6)
        for arguments, cause in (({"delay_ticks": -1}, "-1; allowed is 0 to 20"), ({"delay_ticks": 10**6}, "allowed is 0 to 20"),
                                 ({"limits": upside_down}, "a lower limit is not below"),
                                 ({"limits": viable.Limits(velocity=np.nan, joints=6)}, "or is NaN")):
            expect_refusals(self, (lambda: self.robot.gains(0.001, **arguments), "Robot.gains: .*" + cause))
        for arguments in ({"delay_ticks": 20}, {"limits": unlimited}):
            self.assertTrue(all(np.isfinite(value).all() for value in self.robot.gains(0.001, **arguments).values()))

    def test_messages_are_text_whatever_their_bytes_are(self):
        with self.assertRaisesRegex(viable.InputError, "no_\N{REPLACEMENT CHARACTER}_robot"):
            viable.Robot(b"no_\xff_robot")
        for before in ("", "x"):  # wherever a message is cut off
            guard = self.make()

            def law(q, qd, dynamics):
                raise ValueError(before + "é" * 5000)

            guard.step(self.robot.home, self.robot.home * 0, law)
            self.assertEqual(guard.stop_reason, "law_failed")
            self.assertIn("é", guard.stop_message)

    def test_foreign_code_amid_the_arguments_changes_nothing(self):
        robot, q = self.robot, self.robot.home

        class Torque:
            def __array__(self, *args, **kwargs):
                robot.dynamics(q + 1.0, q)
                return np.zeros(6)

        np.testing.assert_array_equal(robot.forward_dynamics(q, q * 0, Torque()), robot.forward_dynamics(q, q * 0, np.zeros(6)))

    def test_limits_hold_whatever_a_law_gives(self):
        rng = np.random.default_rng(1)
        for name in ("indy7", "panda", "ur5e"):
            robot = viable.Robot(name)
            guard = viable.Guard(robot, 0.001)
            guard.start(robot.home)
            torque = [np.zeros(len(robot))]

            def law(q, qd, dynamics):
                if rng.random() < 0.02:
                    torque[0] = dynamics.b + rng.uniform(-3, 3, len(robot)) * 300 * np.diag(dynamics.M)
                return torque[0]

            states = follow(guard, law, 3000)
            jerk = np.diff(states[:, 2], axis=0) / 0.001
            self.assertLess(largest_excess(states[1:], jerk, robot.limits), 1e-9, name)
            self.assertGreater(np.ptp(states[:, 0]), 0.05, "the arm did not move")
            self.assertEqual(guard.stop_reason, "none")

    def test_bit_equal_to_the_program(self):
        log = run_teleoperation(self, "C3", {"duration_s": 4})
        q, qd, qdd = (log.joint_array("nominal", name) for name in ("q_rad", "qd_radps", "qdd_radps2"))
        wanted, filtered = log.joint_array("desired", "tau_Nm"), log.joint_array("filter", "tau_Nm")
        guard = viable.Guard(self.robot, 0.001, limits=read_limits(log), k_alpha=5, gamma=20, robust_loop=False)
        guard.start(q[0], qd[0])
        self.assertGreater(np.count_nonzero(log["tick.status"] != "passed"), 1000)
        for i in range(len(q)):
            np.testing.assert_array_equal(np.array(guard.nominal), [q[i], qd[i], qdd[i]], f"tick {i}")
            torque = guard.step(q[i], qd[i], wanted[i])
            np.testing.assert_array_equal(torque, np.clip(filtered[i], -self.robot.torque_limit, self.robot.torque_limit))

    def test_arrays_of_any_kind_give_the_same(self):
        home, torque = self.robot.home.astype(np.float32), np.linspace(-20, 20, 6, dtype=np.float32)
        strided = np.zeros((6, 3))[:, 1]
        backwards = torque[::-1].copy()[::-1]
        frozen = torque.copy()
        frozen.flags.writeable = False
        expected = None
        for given in (torque, torque.astype(float), list(map(float, torque)), backwards, frozen,
                      torque.astype(">f8"), np.asfortranarray(torque)):
            guard = viable.Guard(self.robot)
            guard.start(home)
            strided[:] = home
            answer = guard.step(strided, np.zeros(6, int), given)
            expected = answer if expected is None else expected
            np.testing.assert_array_equal(answer, expected)
        np.testing.assert_array_equal(frozen, torque)
        answer[:] = 7  # a copy of its own
        self.assertNotEqual(guard.torque[0], 7)

    def test_what_is_no_array_of_joints_is_told(self):
        guard, zero = self.make(), np.zeros(6)
        for value, cause in ((np.zeros(5), r"the array has shape \(5,\)"), (np.zeros((6, 1)), r"shape \(6, 1\)"),
                             (np.zeros((1, 6)), r"shape \(1, 6\)"), (1.0, r"shape \(\)"), ("none", "type is <U4"),
                             (zero + 1j, "type is complex128"), (object(), "type is object"), (None, "type is object"),
                             ([[1], [1, 2]], "no array of numbers|type is object")):
            with self.subTest(value=value), self.assertRaisesRegex(viable.InputError, cause) as caught:
                guard.step(zero, value, zero)
            self.assertEqual(caught.exception.place, "Guard.step: qd")
            self.assertTrue(caught.exception.remedy)
        self.assertEqual(guard.status, "not_started")  # since no step was made
        with self.assertRaises(TypeError):
            guard.step(zero)
        three = viable.Limits(position=1, velocity=1, acceleration=2, jerk=20, joints=3)
        expect_refusals(self, (lambda: guard.start(self.robot.home + 9), "outside its limits: position"),
                        (lambda: viable.Guard(self.robot, 2), r"the tick is 2 s; allowed is \[0.00001, 0.1\]|the tick is 2 s"),
                        (lambda: viable.Guard(self.robot, limits=three), "limits are those of 3 joints; the robot has 6"),
                        (lambda: viable.Guard(self.robot, objective="speed"),
                         "Guard: objective: `speed` is not one of the choices. .*`torque`, `tool`, `joint`, `path`"))

    def test_keywords_are_checked_as_settings_of_a_file(self):
        for make in (viable.Guard, viable.Batch):
            name = make.__name__
            for keywords, cause in (
                ({"k_alfa": 5}, f"{name}: k_alfa: the key `k_alfa` is unknown. Did you mean `k_alpha`. Known keys: `limits`"),
                ({"limit": None}, "Did you mean `limits`"),
                ({"gamma": 0}, rf"{name}: gamma: 0 is out of range; allowed is \(0, inf\)"),
                ({"gamma": None}, "gamma: .* empty"), ({"gamma": "fast"}, "gamma: "), ({"gamma": object()}, "gamma: "),
                ({"gamma": np.nan}, "gamma: `?.nan`? is not a number"), ({"gamma": 2j}, "gamma: "),
                ({"recovery": "yes"}, "recovery: must be `true` or `false`"),
                *(({"recovery": flag}, "recovery: must be `true` or `false`") for flag in (2, -1, 1 << 80, 1.0, np.ones(2))),
                ({"k_alfa": 5, "gamma": -1, "limits": [1]}, rf"3 things are wrong:(.|\n)*{name}: limits: a list are no(.|\n)*k_alpha(.|\n)*-1 is out"),
            ):
                with self.subTest(make=name, keywords=keywords), self.assertRaisesRegex(viable.InputError, cause):
                    make(self.robot, **keywords)
        for keywords, cause in (({"largest_deviation": [1, 2]}, "Guard: largest_deviation: must be a list of 6 numbers"),
                                ({"largest_deviation": [1, 1, 1, 1, 1, 0]}, r"largest_deviation\[5\]: 0 is out of range"),
                                ({"largest_speed": -1}, "Guard: largest_speed: -1 is out of range")):
            expect_refusals(self, (lambda: viable.Guard(self.robot, **keywords), cause))
        viable.Guard(self.robot, 0.001, limits=None, k_alpha=np.inf, gamma=np.float32(10), recovery=np.bool_(True), objective="path",
                     robust_loop=np.int64(0), largest_deviation=np.full(6, 0.2), largest_speed=None)
        with self.assertRaises(TypeError):
            viable.Guard(self.robot, 0.001, self.robot.limits)

    def test_readings_and_torques_that_are_no_numbers(self):
        guard, zero = self.make(), np.zeros(6)
        nan = np.full(6, np.nan)
        q = self.robot.home
        gravity = self.robot.dynamics(q).gravity
        guard.step(q, zero, gravity)
        self.assertEqual(guard.status, "passed")
        self.assertTrue(np.isfinite(guard.step(q, zero, nan)).all())
        self.assertTrue(guard.law_failed)
        self.assertTrue(np.isfinite(guard.step(nan, zero, gravity)).all())
        self.assertEqual((guard.status, guard.reading_fault), ("waiting", "malformed"))
        for _ in range(10):
            guard.step(q, nan, gravity)
        self.assertEqual(guard.stop_reason, "no_readings")
        self.assertIn("engage the brakes", guard.stop_message)
        self.assertTrue(np.isfinite(guard.step(q, zero, nan)).all())
        guard.start(q)
        for _ in range(12):
            guard.step(q, zero, nan)
        self.assertEqual((guard.stop_reason, guard.status), ("law_failed", "stopped"))

    def test_a_law_that_raises_stops_the_arm_and_is_kept(self):
        for law, kind in ((lambda q, qd, d: 1 / 0, ZeroDivisionError), (lambda q, qd, d: np.zeros(3), viable.Error),
                          (lambda q: q, TypeError), (lambda q, qd, d: None, viable.Error)):
            guard = self.make()
            follow(guard, spring, 200)
            self.assertIsNone(guard.law_error)
            states = follow(guard, law, 1)
            self.assertIsInstance(guard.law_error, kind)
            self.assertEqual((guard.status, guard.stop_reason), ("stopping", "law_failed"))
            states = follow(guard, spring, 2000)
            self.assertEqual(guard.status, "stopped")
            np.testing.assert_array_equal(states[-1, 1:], 0)
            self.assertIn("it threw", guard.stop_message)

    def test_interrupts_pass_through_a_law(self):
        guard = self.make()

        def law(q, qd, dynamics):
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            follow(guard, law, 1)
        self.assertEqual(guard.stop_reason, "law_failed")
        follow(guard, spring, 10)
        self.assertEqual(guard.status, "stopped")

    def test_a_guard_is_not_called_from_its_own_law(self):
        guard = self.make()

        def law(q, qd, dynamics):
            return guard.step(q, qd, dynamics.b)

        follow(guard, law, 1)
        self.assertIn("by its own law or by another thread", str(guard.law_error))
        self.assertEqual(guard.stop_reason, "law_failed")

    def test_garbage_is_collected_and_the_guard_forgotten_during_a_law(self):
        class Node:
            pass

        holder = [self.make()]
        kept = []

        def law(q, qd, dynamics):
            node = Node()
            node.self, node.arrays = node, (q, qd, dynamics)
            del node
            holder.clear()
            gc.collect()
            kept.append(dynamics)
            return dynamics.b

        guard = holder[0]
        gc.set_threshold(1)
        try:
            q, qd, _ = guard.nominal
            first = guard.nominal.q
            for _ in range(100):
                guard.step(q, qd, law)
        finally:
            gc.set_threshold(700, 10, 10)
        np.testing.assert_array_equal(kept[0].M, self.robot.dynamics(first).M)  # outlives the call
        holder.append(self.make())
        holder[0].step(q, qd, law)  # whose last reference goes inside the call

    def test_threads_and_forks_compute_the_same(self):
        expected = follow(self.make(), spring, 500)
        with ThreadPoolExecutor(4) as pool:
            for result in pool.map(lambda _: follow(self.make(), spring, 500), range(4)):
                np.testing.assert_array_equal(result, expected)
        guard = self.make()
        follow(guard, spring, 100)
        child = os.fork()
        if child == 0:
            same = np.array_equal(follow(guard, spring, 400), expected[100:])
            os._exit(0 if same else 1)
        self.assertEqual(os.waitpid(child, 0)[1], 0)
        np.testing.assert_array_equal(follow(guard, spring, 400), expected[100:])

    def test_a_stop_is_requested_from_another_thread(self):
        guard = self.make()
        follow(guard, spring, 100)
        thread = threading.Thread(target=guard.request_stop)
        thread.start()
        thread.join()
        follow(guard, spring, 1000)
        self.assertEqual((guard.status, guard.stop_reason), ("stopped", "requested"))

    def test_missed_ticks_follow_the_stop(self):
        guard = self.make()
        follow(guard, spring, 200)
        self.assertGreater(abs(guard.nominal.qd).max(), 0.1)
        guard.miss_ticks(900)
        np.testing.assert_allclose(guard.nominal.qd, 0, atol=1e-9)
        follow(guard, spring, 10)
        self.assertEqual(guard.stop_reason, "none")
        guard.miss_ticks(1001)
        follow(guard, spring, 1)
        self.assertEqual(guard.stop_reason, "ticks_missed")


class References(unittest.TestCase):
    def test_targets_are_reached_within_the_limits(self):
        robot = viable.Robot("panda")
        limits = robot.limits
        lower, upper = limits.position
        rng = np.random.default_rng(2)
        guard = viable.ReferenceGuard(robot, 0.001)
        guard.start(robot.home)
        states = []
        for i in range(4000):
            target = rng.uniform(lower - 1, upper + 1) if i % 300 == 0 and i < 3000 else None
            states.append(guard.step(target))
            self.assertIn(guard.status, ("passed", "limited"))
        states = np.array(states)
        self.assertLess(largest_excess(states[1:], np.diff(states[:, 2], axis=0) / 0.001, limits), 1e-9)
        goal = np.full(7, 0.0) + (lower + upper) / 2
        for i in range(6000):
            end = guard.step(goal if i == 0 else None)
        np.testing.assert_allclose(end.q, goal, atol=1e-9)
        np.testing.assert_allclose(end.qd, 0, atol=1e-9)

    def test_the_rest_of_it(self):
        robot = viable.Robot("indy7")
        guard = viable.ReferenceGuard(robot, between="hold", velocity_filter=np.inf)
        expect_refusals(self, (lambda: guard.start(robot.home, [0, 0]), r"ReferenceGuard.start: qd: the array has shape \(2,\)"),
                        (guard.step, r"ReferenceGuard.step: start\(\) has not been called"),
                        (lambda: viable.ReferenceGuard(robot, between="never"),
                         "ReferenceGuard: between: .*Choices: `hold`, `interpolate`, `extrapolate`"))
        self.assertEqual(guard.status, "not_started")
        guard.start(robot.home)
        guard.step(np.full(6, np.nan))
        self.assertTrue(guard.target_failed)
        for _ in range(100):
            guard.step(robot.home + 1)
        self.assertFalse(guard.target_failed)
        rest = guard.stop_after(10)
        np.testing.assert_allclose(rest.qd, 0, atol=1e-9)
        self.assertFalse(guard.change_limits(viable.Limits(velocity=1, joints=6)))  # no jerk limits
        self.assertTrue(guard.change_limits(robot.limits.replace(velocity=0.2)))
        for _ in range(1500):
            end = guard.step()
        self.assertLessEqual(abs(end.qd).max(), 0.2 + 1e-9)
        guard.request_stop()
        for _ in range(1500):
            guard.step()
        self.assertEqual((guard.status, guard.stop_reason), ("stopped", "requested"))


class Servos(unittest.TestCase):
    def test_the_jerks_are_those_of_a_reference_guard(self):
        robot = viable.Robot("ur5e")
        guard = viable.ReferenceGuard(robot, between="hold", velocity_filter=np.inf)
        guard.start(robot.home)
        servo = viable.Servo(robot.limits, 0.001)
        servo.reset(robot.home)
        q, qd, qdd = robot.home, np.zeros(6), np.zeros(6)
        rng = np.random.default_rng(5)
        for i in range(2000):
            if i % 400 == 0:
                target = robot.home + rng.uniform(-1, 1, 6)
            jerk = servo.jerk(q, qd, qdd, target)
            moved = guard.step(target)
            np.testing.assert_array_equal(moved.qdd, qdd + jerk * 0.001)
            q, qd, qdd = moved
        self.assertGreater(abs(q - robot.home).max(), 0.1)

    def test_what_does_not_fit_is_told(self):
        limits = viable.Limits(position=2, velocity=1, acceleration=5, jerk=50, joints=2)
        expect_refusals(self, (lambda: viable.Servo(limits.replace(jerk=None)), "not usable at a tick of 0.001 s"),
                        (lambda: viable.Servo(limits, 1.0), "not usable at a tick of 1 s"),
                        (lambda: viable.Servo(limits, share=0), "allowed is above 0, up to 1"),
                        (lambda: viable.Servo(None), "None are no limits"),
                        (lambda: viable.Servo(limits).reset([0, np.nan]), "a number is not finite"),
                        (lambda: viable.Servo(limits).jerk([0, 0], [0, 0], [0, 0], [1]), r"target: .*shape \(1,\)"))


class Robots(unittest.TestCase):
    def test_dynamics_agree_with_themselves(self):
        robot = viable.Robot("ur5e")
        rng = np.random.default_rng(3)
        q, qd, torque = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 6), rng.uniform(-50, 50, 6)
        d = robot.dynamics(q, qd)
        qdd = robot.forward_dynamics(q, qd, torque)
        np.testing.assert_allclose(d.M @ qdd + d.b, torque, rtol=1e-9)
        np.testing.assert_allclose(robot.dynamics(q).b, robot.dynamics(q).gravity, atol=1e-9)
        step = 1e-6
        rate = (robot.dynamics(q + step * qd).tool[:3, 3] - robot.dynamics(q - step * qd).tool[:3, 3]) / (2 * step)
        np.testing.assert_allclose(d.J[:3] @ qd, rate, atol=1e-8)
        weight = robot.with_payload(2.0).dynamics(q).gravity - d.gravity
        np.testing.assert_allclose(weight, d.J[2] * 2.0 * 9.81, atol=1e-9)
        np.testing.assert_allclose(robot.with_scaled_masses(2.0).dynamics(q).gravity, 2 * d.gravity)

    def test_gains_and_figures(self):
        robot = viable.Robot("indy7")
        gains = robot.gains(0.001)
        self.assertGreaterEqual(gains["gain_margin"], 2.0)
        self.assertEqual(gains["k_r"].shape, (6,))
        self.assertTrue((robot.torque_limit > 0).all())
        self.assertEqual(robot.friction["coulomb"].shape, (6,))
        self.assertEqual((len(robot), robot.joints[0], robot.name), (6, "joint0", "indy7"))
        again = viable.Robot(robot.folder)
        self.assertEqual(again.limits, robot.limits)
        with self.assertRaisesRegex(viable.InputError, "there is no robot called `indy8`. Did you mean `indy7`") as caught:
            viable.Robot("indy8")
        error = pickle.loads(pickle.dumps(caught.exception))
        self.assertEqual((str(error), error.kind, error.place), (str(caught.exception), "bad_input", "Robot"))
        self.assertIsInstance(error, ValueError)
        self.assertIsInstance(error, RuntimeError)

    def test_limits(self):
        limits = viable.Limits(position=([-1, -2], 3), velocity=2, acceleration=[5, 6], jerk=100)
        np.testing.assert_array_equal(limits.position, [[-1, -2], [3, 3]])
        np.testing.assert_array_equal(limits.acceleration, [[-5, -6], [5, 6]])
        changed = limits.replace(jerk=None, velocity=(-1, 2))
        np.testing.assert_array_equal(changed.velocity, [[-1, -1], [2, 2]])
        self.assertTrue(np.isinf(changed.jerk).all())
        self.assertNotEqual(changed, limits)
        expect_refusals(self, (lambda: viable.Limits(position=1), "nothing says how many joints"),
                        (lambda: viable.Limits(position=[1, 2], velocity=[1, 2, 3]), r"shape \(3,\)"),
                        (lambda: viable.Limits(position=(1, 2, 3), joints=2), "a tuple of 3"),
                        (lambda: viable.Limits(joints=17), "17 joints"),
                        (lambda: limits.replace(speed=1), "no limit `speed`"),
                        (lambda: viable.Guard(viable.Robot("indy7"), limits=[1, 2]), "a list are no limits"))


class Surroundings(unittest.TestCase):
    """What else is loaded into the interpreter."""

    def test_import_without_numpy_says_what_is_missing(self):
        code = "import sys; sys.modules['numpy'] = None\nimport viable"
        ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual(ended.returncode, 1)
        self.assertIn("numpy", ended.stderr.splitlines()[-1])

    def test_import_before_and_after_numpy(self):
        for code in ("import viable, numpy", "import numpy, viable"):
            code += "; r = viable.Robot('indy7'); assert type(r.home) is numpy.ndarray; assert r.home.flags.owndata"
            subprocess.run([sys.executable, "-c", code], check=True)


if __name__ == "__main__":
    unittest.main()
