"""Environments for Gymnasium (1.0 and newer), which must be installed: `import viable.gym`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ._batch import Batch
from ._errors import InputError
from ._types import STATUS
from ._viable import Limits, Robot

try:
    import gymnasium
except ImportError as error:
    raise ImportError("viable.gym needs Gymnasium 1.0 or newer: pip install gymnasium") from error


class ReachVectorEnv(gymnasium.vector.VectorEnv):
    """Arms that move their tools to goals, each arm's limits up to jerk guaranteed: no action breaks a constraint.

        env = viable.gym.ReachVectorEnv("panda", num_envs=4096)
        observations, infos = env.reset(seed=1)
        observations, rewards, terminations, truncations, infos = env.step(env.action_space.sample())

    Observation, float32: positions as shares of their limits (-1 to 1; joints without: sine), velocities as shares of their limits,
    and the way from tool to goal [m]: 2 n + 3 numbers. With a plant positions and velocities are those of the real arms, as measured.
    Action, -1 to 1 for each joint: a share of the acceleration limit, or of the position limits for action="target"; beyond
    that range it is cut.
    Reward: minus the distance of the tool from the goal [m]. Terminated: it is within `reach` [m]. Truncated: after `horizon` steps,
    or its plant failed. The tool is that of the nominal arm, also with a plant: where the real one lags behind, reward and end do not
    show it.
    Goals are the tool's places at random poses. An arm that has ended begins anew in the next step, whose action it ignores
    (AutoresetMode.NEXT_STEP).
    infos: `limited`, (num_envs,) of truths: the guard changed what the action asked for.

    robot      a viable.Robot or its name
    substeps   ticks of `tick` seconds that an action holds
    limits, plant, threads   as of viable.Batch
    """

    def __init__(self, robot: Robot | str = "panda", num_envs: int = 1024, *, action: str = "acceleration", substeps: int = 10,
                 horizon: int = 300, reach: float = 0.05, tick: float = 0.001, limits: Limits | None = None,
                 plant: Mapping[str, Any] | None = None, threads: int = 0) -> None:
        if action not in ("acceleration", "target"):
            raise InputError("ReachVectorEnv: action", f"`{action}`", "It is acceleration or target.")
        self.robot = Robot(robot) if isinstance(robot, str) else robot
        self.batch = Batch(self.robot, num_envs, tick, limits=limits, action=action, plant=plant, threads=threads)
        self.num_envs, self.substeps, self.horizon, self.reach = num_envs, substeps, horizon, reach
        bounds = self.batch.limits()
        n = len(self.robot)
        if action == "acceleration":
            self._lower, self._upper = np.maximum(bounds.acceleration[0], -1e3), np.minimum(bounds.acceleration[1], 1e3)
        else:
            self._lower, self._upper = np.maximum(bounds.position[0], -np.pi), np.minimum(bounds.position[1], np.pi)
        self._positions, self._fastest = bounds.position, np.minimum(np.maximum(-bounds.velocity[0], bounds.velocity[1]), 1e3)
        self._is_bounded = np.isfinite(self._positions).all(axis=0)
        box = gymnasium.spaces.Box
        self.single_action_space = box(-1.0, 1.0, (n,), np.float32)
        self.action_space = box(-1.0, 1.0, (num_envs, n), np.float32)
        self.single_observation_space = box(-np.inf, np.inf, (2 * n + 3,), np.float32)
        self.observation_space = box(-np.inf, np.inf, (num_envs, 2 * n + 3), np.float32)
        mode = getattr(gymnasium.vector, "AutoresetMode", None)
        self.metadata = {"autoreset_mode": mode.NEXT_STEP} if mode else {}
        self.goals = np.zeros((num_envs, 3))
        self._steps = np.zeros(num_envs, int)
        self._ended = np.zeros(num_envs, bool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self._begin(np.ones(self.num_envs, bool))
        return self._observe(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        shares = (np.clip(np.asarray(actions, float), -1.0, 1.0) + 1.0) / 2.0
        self.batch.step(self._lower + shares * (self._upper - self._lower), self.substeps)
        limited = (self.batch.acting != 0).any(axis=1)
        failed = self.batch.status == STATUS.index("failed")  # stands until its reset
        self._steps += 1
        begun = self._ended
        if begun.any():
            self._begin(begun)
        observations = self._observe()
        distances = np.linalg.norm(observations[:, -3:], axis=1).astype(float)
        terminations = (distances < self.reach) & ~failed & ~begun
        truncations = ((self._steps >= self.horizon) | failed) & ~terminations & ~begun
        self._ended = terminations | truncations
        return observations, np.where(begun, 0.0, -distances), terminations, truncations, {"limited": limited & ~begun}

    def _begin(self, which: np.ndarray) -> None:
        """Puts arms to random places at rest, and their goals elsewhere."""
        rng = self.np_random
        self.batch.random_reset(rng, which)
        lower, upper = np.maximum(self._positions[0], -np.pi), np.minimum(self._positions[1], np.pi)
        for arm in np.flatnonzero(which):
            self.goals[arm] = self.robot.dynamics(rng.uniform(lower, upper)).tool[:3, 3]
        self._steps[which] = 0
        self._ended = self._ended & ~which

    def _observe(self) -> np.ndarray:
        batch = self.batch
        q, qd = (batch.q, batch.qd) if batch.real_q is None else (batch.real_q, batch.real_qd)
        with np.errstate(invalid="ignore"):
            middle, half = self._positions.mean(axis=0), np.ptp(self._positions, axis=0) / 2
            shares = np.where(self._is_bounded, (q - middle) / half, np.sin(q))
        return np.hstack([shares, qd / self._fastest, self.goals - batch.tool_position()]).astype(np.float32)
