"""GuardedActions around other people's environment: the Panda of Gymnasium-Robotics' kitchen, in MuJoCo."""

import importlib.util
import unittest

import numpy as np

import viable
from support import EFFORT, bring, expect_refusals, find_largest

NAMES = {f"joint{i}": f"robot:panda0_joint{i}" for i in range(1, 8)}


def setUpModule():
    global gym, gymnasium, mujoco
    if importlib.util.find_spec("gymnasium_robotics") is None:
        bring("gymnasium-robotics==1.4.2", "gymnasium==1.4.0", "mujoco==3.3.2")
    gymnasium, mujoco, robotics = map(importlib.import_module, ("gymnasium", "mujoco", "gymnasium_robotics"))
    gym = importlib.import_module("viable.gym")
    gymnasium.register_envs(robotics)


def make(contacts):
    env = gymnasium.make("FrankaKitchen-v1", max_episode_steps=10**9, disable_env_checker=True)
    if not contacts:
        env.unwrapped.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return env


class Recorder:
    """A ReferenceGuard whose references are kept."""

    def __init__(self, guard):
        self.guard, self.states = guard, []

    def __getattr__(self, name):
        return getattr(self.guard, name)

    def step(self, target):
        self.states.append(self.guard.step(target))
        return self.states[-1]


class Guarded(unittest.TestCase):
    def drive(self, env, steps, hold, look):
        env.reset(seed=1)
        rng = np.random.default_rng(0)
        for k in range(steps):
            if k % hold == 0:
                action = rng.uniform(-1, 1, 9) if hold == 1 else np.sign(rng.uniform(-1, 1, 9))
            _, _, terminated, _, infos = env.step(action)
            look(infos)
            if terminated:
                break

    def test_the_arm_in_the_simulator_keeps_limits_that_it_breaks_alone(self):
        slow = viable.Robot("panda").limits.replace(velocity=0.35)  # leaves room: 0.5 rad/s are to be kept by the arm itself
        worst = {}
        for contacts in (False, True):
            for hold in (1, 25):
                plain, fastest = make(contacts), []
                self.drive(plain, 200, hold, lambda _: fastest.append(abs(plain.unwrapped.data.qvel[:7]).max()))
                self.assertGreater(max(fastest), 0.7)
                env = gym.GuardedActions(make(contacts), "panda", NAMES, limits=slow)
                env.guard = recorder = Recorder(env.guard)
                seen = []
                self.drive(env, int(500 * EFFORT), hold, lambda infos: seen.append(infos["guard"]))
                # What the servos are told keeps every limit in every step of the simulator; whatever the actions are.
                self.assertEqual(len(recorder.states), 40 * len(seen))
                q, qd, qdd = (np.array([getattr(state, name) for state in recorder.states]) for name in ("q", "qd", "qdd"))
                inside = np.flatnonzero(((slow.position[0] <= q) & (q <= slow.position[1])).all(axis=1))[0]  # the kitchen begins outside
                self.assertLess(inside, 200)
                jerk = np.diff(qdd, axis=0) / 0.002
                pairs = ((q, slow.position), (qd, slow.velocity), (qdd, slow.acceleration), (jerk, slow.jerk))
                self.assertLess(find_largest([(values[inside:], limits) for values, limits in pairs]), 1e-9)
                self.assertGreater(abs(qd).max(), 0.349)
                np.testing.assert_array_equal(seen[-1]["reference"], q[-1])
                np.testing.assert_array_equal(seen[-1]["q"], env.unwrapped.data.qpos[:7])
                worst[contacts, hold] = [max(each[f"{name}_excess"] for each in seen) for name in ("position", "velocity")]
                print(f"{'with' if contacts else 'no'} contacts, an action for {hold} steps: MuJoCo's own positions beyond their limits "
                      f"by {1000 * worst[contacts, hold][0]:.1f} mrad, velocities by {worst[contacts, hold][1]:.3f} rad/s (alone {max(fastest) - 0.35:.3f})")
        for hold in (1, 25):  # what soft servos and weight add; contacts push as they like
            self.assertLess(worst[False, hold][0], 0.01)
            self.assertLess(worst[False, hold][1], 0.15)

    def test_where_nothing_is_in_the_way_the_arm_does_what_it_does_alone(self):
        wide = viable.Limits(position=np.full(7, 12.0), velocity=np.full(7, 90.0), acceleration=np.full(7, 4e4), jerk=np.full(7, 1e7))
        plain, env = make(False), gym.GuardedActions(make(False), "panda", NAMES, limits=wide)
        ways = [], []
        self.drive(plain, 100, 25, lambda _: ways[0].append(plain.unwrapped.data.qpos[:7].copy()))
        self.drive(env, 100, 25, lambda infos: ways[1].append(infos["guard"]["q"]))
        self.assertGreater(np.ptp(ways[0], axis=0).min(), 0.5)
        # A jump of what is asked takes some steps of 2 ms, of the 40 for which an action is held.
        self.assertLess((abs(np.subtract(*ways)).max(axis=0) / np.ptp(ways[0], axis=0)).max(), 0.1)

    def test_two_arms_in_one_process_are_guarded_each_by_its_own(self):
        envs = [gym.GuardedActions(make(False), "panda", NAMES) for _ in range(2)]
        for env in envs:
            env.reset(seed=2)
        for k in range(5):
            infos = [env.step(np.full(9, sign))[4]["guard"] for env, sign in zip(envs, (1.0, -1.0))]
        self.assertTrue((infos[0]["reference"] > infos[1]["reference"]).all())

    def test_what_does_not_fit_is_told(self):
        env = make(False)
        expect_refusals(self, (lambda: gym.GuardedActions(env, "panda", {"joint1": "robot:panda0_joint1"}), "Map joint1, joint2"),
                        (lambda: gym.GuardedActions(env, "panda", NAMES | {"joint4": "elbow"}), "no joint `elbow`"),
                        (lambda: gym.GuardedActions(env, "panda", NAMES | {"joint4": "knob_Joint_1"}),
                         "`knob_Joint_1` is not moved by one position servo"),
                        (lambda: gym.GuardedActions(gymnasium.make("viable/Reach-v0"), "panda", NAMES), "has no MuJoCo model"))
        twice = gym.GuardedActions(gym.GuardedActions(env, "panda", NAMES), "panda", NAMES)
        twice.reset(seed=1)
        expect_refusals(self, (lambda: twice.step(np.zeros(9)), "guards the same simulation"))
        env.unwrapped.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        expect_refusals(self, (lambda: gym.GuardedActions(env, "panda", NAMES), "its integrator is RK4"))


if __name__ == "__main__":
    unittest.main()
