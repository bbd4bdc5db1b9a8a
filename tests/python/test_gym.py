"""The environments, with Gymnasium itself."""

import importlib.util
import subprocess
import sys
import unittest
import warnings

import numpy as np

import viable
from support import assert_same, bring, expect_refusals


def setUpModule():
    global gym, gymnasium
    if importlib.util.find_spec("gymnasium") is None:
        bring("gymnasium==1.4.0", "cloudpickle==3.1.3", "typing_extensions==4.16.0", "Farama-Notifications==0.0.6")
    gymnasium = importlib.import_module("gymnasium")
    gym = importlib.import_module("viable.gym")


class Reach(unittest.TestCase):
    def test_shapes_seeds_and_limits(self):
        for action in ("torque", "acceleration", "target", "tool"):
            env = gym.ReachVectorEnv("panda", num_envs=50, action=action)
            other = gym.ReachVectorEnv("panda", num_envs=50, action=action, threads=1)
            rng = np.random.default_rng(1)
            first, _ = env.reset(seed=3)
            np.testing.assert_array_equal(first, other.reset(seed=3)[0])
            self.assertFalse(np.array_equal(first, env.reset(seed=4)[0]))
            env.reset(seed=3)
            self.assertTrue(env.observation_space.contains(first))
            limited = 0
            for _ in range(100):
                actions = rng.uniform(-1.5, 1.5, env.action_space.shape).astype(np.float32)
                answer, same = env.step(actions), other.step(actions)
                assert_same(answer[:4], same[:4])
                observations, rewards, terminations, truncations, infos = answer
                self.assertTrue(env.observation_space.contains(observations))
                self.assertLessEqual(abs(observations[:, :14]).max(), 1 + 1e-6)  # the limits
                self.assertEqual((rewards.shape, terminations.dtype, truncations.dtype), ((50,), bool, bool))
                self.assertTrue((rewards <= 0).all())
                limited += infos["limited"].sum()
            if action in ("torque", "acceleration"):
                self.assertGreater(limited, 100)
            self.assertEqual(env.action_space.shape, (50, 3 if action == "tool" else 7))

    def test_arms_reach_and_begin_anew(self):
        env = gym.ReachVectorEnv("ur5e", num_envs=8, action="target", horizon=150, reach=0.02)
        env.reset(seed=5)
        # The pose of each goal is not known: find one by the Jacobian, as a policy would learn to.
        poses = env.batch.q.copy()
        for _ in range(400):
            for arm in range(8):
                d = env.robot.dynamics(poses[arm])
                way = env.goals[arm] - d.tool[:3, 3]
                poses[arm] += d.J[:3].T @ np.linalg.solve(d.J[:3] @ d.J[:3].T + 0.01 * np.eye(3), 0.2 * way)
                poses[arm] = np.clip(poses[arm], env._lower, env._upper)
        actions = 2 * (poses - env._lower) / (env._upper - env._lower) - 1
        ended, begun = np.zeros(8, int), 0
        before = np.zeros(8, bool)
        for step in range(150):
            goals = env.goals.copy()
            observations, rewards, terminations, truncations, _ = env.step(actions)
            self.assertTrue((rewards[before] == 0).all())
            self.assertFalse((terminations | truncations)[before].any())
            self.assertTrue((np.linalg.norm(observations[terminations, -3:], axis=1) < 0.02).all())
            changed = (env.goals != goals).any(axis=1)
            np.testing.assert_array_equal(changed, before)  # in the step after its end
            np.testing.assert_allclose(env.batch.qd[before], 0)
            self.assertFalse(step < 149 and truncations.any())
            ended += terminations
            begun += before.sum()
            before = terminations | truncations
        np.testing.assert_array_equal(truncations, ended == 0)
        self.assertGreaterEqual((ended > 0).sum(), 4)
        self.assertGreater(begun, 0)

    def test_real_arms_are_observed(self):
        env = gym.ReachVectorEnv("indy7", num_envs=5, plant={"payload_kg": "~uniform(0, 2)"})
        env.reset(seed=1)
        observations = env.step(np.ones((5, 6)))[0]
        middle, half = env._positions.mean(axis=0), np.ptp(env._positions, axis=0) / 2
        np.testing.assert_allclose(observations[:, :6], (env.batch.real_q - middle) / half, atol=1e-6)
        self.assertTrue((env.batch.real_q != env.batch.q).any())

    def test_tools_reach_where_they_are_sent(self):
        env = gym.ReachVectorEnv("panda", num_envs=20, action="tool", reach=0.02)
        env.reset(seed=2)
        lower, upper = env.places
        self.assertTrue(((lower < env.goals) & (env.goals < upper)).mean() > 0.95)
        reached = np.zeros(20, bool)
        for _ in range(299):
            actions = 2 * (env.goals - lower) / (upper - lower) - 1
            _, rewards, terminations, _, _ = env.step(actions)
            self.assertTrue((rewards[terminations] > -0.02).all())
            reached |= terminations
        self.assertGreaterEqual(reached.sum(), 16)  # others wind themselves up at a limit

    def test_rewards_are_of_the_real_tool(self):
        env = gym.ReachVectorEnv("indy7", num_envs=4, plant={"payload_kg": "~uniform(1, 2)"})
        env.reset(seed=1)
        for _ in range(20):
            observations, rewards, _, _, _ = env.step(np.ones((4, 6)))
        way = [env.goals[i] - env.robot.dynamics(env.batch.real_q[i]).tool[:3, 3] for i in range(4)]
        np.testing.assert_allclose(observations[:, -3:], way, atol=1e-6)
        np.testing.assert_allclose(rewards, -np.linalg.norm(way, axis=1), atol=1e-12)
        self.assertGreater(abs(env.batch.tool_position(True) - env.batch.tool_position()).max(), 1e-6)

    def test_autoreset_in_the_same_step(self):
        env = gym.ReachVectorEnv("panda", num_envs=6, horizon=7, autoreset="same_step")
        other = gym.ReachVectorEnv("panda", num_envs=6, horizon=7)
        self.assertEqual(env.metadata["autoreset_mode"], gymnasium.vector.AutoresetMode.SAME_STEP)
        env.reset(seed=4)
        other.reset(seed=4)
        actions = np.random.default_rng(1).uniform(-1, 1, (6, 7))
        for step in range(7):
            answer, expected = env.step(actions), other.step(actions)
            assert_same(answer[1:4], expected[1:4])
            self.assertEqual("final_obs" in answer[4], (answer[2] | answer[3]).any())
        observations, _, terminations, truncations, infos = answer
        np.testing.assert_array_equal(infos["_final_obs"], terminations | truncations)
        self.assertTrue(infos["_final_obs"].all())
        np.testing.assert_array_equal(np.stack(infos["final_obs"]), expected[0])  # how it ended
        np.testing.assert_array_equal(infos["final_info"]["limited"], expected[4]["limited"])
        first = other.step(actions)
        np.testing.assert_array_equal(observations, first[0])  # how it begins: there a step later
        self.assertFalse((first[2] | first[3]).any() or first[1].any() or first[4]["limited"].any() or first[4]["_limited"].any())
        assert_same(env.step(actions)[:4], other.step(actions)[:4])

    def test_only_those_that_ended_have_a_last_observation(self):
        env = gym.ReachVectorEnv("panda", num_envs=20, horizon=1000, reach=0.25, action="tool", autoreset="same_step")
        env.reset(seed=2)
        mixed = 0
        for _ in range(40):
            _, _, terminations, truncations, infos = env.step(np.zeros((20, 3)))
            ended = terminations | truncations
            if not ended.any():
                self.assertNotIn("final_obs", infos)
                continue
            mixed += not ended.all()
            self.assertEqual([each is not None for each in infos["final_obs"]], ended.tolist())
            self.assertEqual({each.shape for each in infos["final_obs"] if each is not None}, {(17,)})
            np.testing.assert_array_equal(infos["_final_info"], ended)
        self.assertGreater(mixed, 0)

    def test_without_autoreset_who_has_ended_is_reset_by_its_user(self):
        env = gym.ReachVectorEnv("panda", num_envs=3, horizon=2, autoreset="disabled", reach=1e-9)
        env.reset(seed=1)
        actions = np.zeros((3, 7))
        env.step(actions)
        mask = np.array([True, False, False])
        before = env.batch.q.copy()
        env.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal((env.batch.q != before).any(axis=1), mask)
        truncations = env.step(actions)[3]
        np.testing.assert_array_equal(truncations, ~mask)
        expect_refusals(self, (lambda: env.step(actions), "arm 1 has ended and was not reset"))
        env.reset(options={"reset_mask": truncations})
        np.testing.assert_array_equal(env.step(actions)[3], mask)
        for wrong in (np.ones(2, bool), np.ones(3)):
            expect_refusals(self, (lambda: env.reset(options={"reset_mask": wrong}), r"Give truths, shape \(3,\)"))

    def test_among_obstacles_arms_begin_and_stay_clear(self):
        around = {"safety_distance_m": 0.03, "obstacles": {"ball": {"sphere": 0.15, "at": {"xyz": [0.3, 0.5, 0.6]}}}}
        env = gym.ReachVectorEnv("panda", num_envs=4, environment=around, horizon=20)
        env.reset(seed=1)
        rng = np.random.default_rng(3)
        for _ in range(25):
            env.step(rng.uniform(-1, 1, (4, 7)))
            clear = env.batch.clearance
            self.assertTrue((np.isnan(clear) | (clear > 0.03 - 1e-6)).all())
        self.assertTrue((np.linalg.norm(env.batch.tool_position() - [0.3, 0.5, 0.6], axis=1) > 0.18).all())

    def test_an_arm_whose_plant_failed_ends(self):
        env = gym.ReachVectorEnv("indy7", num_envs=3, reach=1e-9)
        env.reset(seed=1)
        batch = env.batch

        class Failing:
            status = np.array([1, viable.STATUS.index("failed"), 1], np.uint8)

            def __getattr__(self, name):
                return getattr(batch, name)

        env.batch = Failing()
        _, _, terminations, truncations, _ = env.step(np.zeros((3, 6)))
        self.assertFalse(terminations.any())
        np.testing.assert_array_equal(truncations, [False, True, False])
        env.batch = batch
        goals = env.goals.copy()
        truncations = env.step(np.zeros((3, 6)))[3]
        self.assertFalse(truncations.any())
        np.testing.assert_array_equal((env.goals != goals).any(axis=1), [False, True, False])

    def test_what_does_not_fit_is_told(self):
        expect_refusals(self, (lambda: gym.ReachVectorEnv(action="force"), "It is torque, acceleration or target, or tool"),
                        (lambda: gym.ReachVectorEnv(autoreset="never"), "It is next_step, same_step or disabled"))
        env = gym.ReachVectorEnv(num_envs=2)
        env.reset(seed=1)
        with self.assertRaisesRegex(ValueError, "shape|broadcast"):
            env.step(np.zeros((3, 7)))

    def test_gymnasium_makes_one_arm_and_its_checker_passes(self):
        from gymnasium.utils.env_checker import check_env

        for action in gym.ACTIONS:
            env = gymnasium.make("viable/Reach-v0", robot="ur5e", action=action, horizon=30)
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.filterwarnings("ignore", ".*(infinity|-inf|inf).*")  # observations have no bounds
                check_env(env.unwrapped)
            many = gymnasium.make_vec("viable/Reach-v0", num_envs=1, robot="ur5e", action=action, horizon=30)
            np.testing.assert_array_equal(env.reset(seed=5)[0], many.reset(seed=5)[0][0])
            rng = np.random.default_rng(2)
            for step in range(30):
                a = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
                answer, expected = env.step(a), many.step(a[None])
                assert_same(answer[:4], [values[0] for values in expected[:4]])
                self.assertEqual(answer[4]["limited"], expected[4]["limited"][0])
                if answer[2] or answer[3]:
                    break
            self.assertTrue(answer[2] or step == 29)

    def test_gymnasium_makes_many_arms_of_one_batch_and_its_wrappers_take_them(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            env = gymnasium.make_vec("viable/Reach-v0", num_envs=12, robot="indy7", horizon=20, reach=1e-9)
        self.assertIsInstance(env.unwrapped, gym.ReachVectorEnv)
        self.assertEqual(env.unwrapped.batch.q.shape, (12, 6))
        self.assertEqual(env.spec.id, "viable/Reach-v0")
        wrappers = gymnasium.wrappers.vector
        env = wrappers.NormalizeObservation(wrappers.RecordEpisodeStatistics(env))
        env.reset(seed=1)
        env.action_space.seed(1)
        for _ in range(20):
            observations, _, _, truncations, infos = env.step(env.action_space.sample())
        self.assertTrue(truncations.all() and np.isfinite(observations).all())
        np.testing.assert_array_equal(infos["episode"]["l"], 20)
        # Arms one by one, each a batch of its own, are what Gymnasium would do without the entry for vectors.
        each = gymnasium.make_vec("viable/Reach-v0", num_envs=3, vectorization_mode="sync", robot="indy7", horizon=20)
        observations, _ = each.reset(seed=4)
        for arm in range(3):
            np.testing.assert_array_equal(observations[arm], gymnasium.make("viable/Reach-v0", robot="indy7").reset(seed=4 + arm)[0])

    def test_without_gymnasium_the_import_says_what_is_missing(self):
        code = "import sys; sys.modules['gymnasium'] = None\nimport viable\nimport viable.gym"
        ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertIn("viable.gym needs Gymnasium", ended.stderr)


if __name__ == "__main__":
    unittest.main()
