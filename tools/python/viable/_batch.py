"""Many guarded arms at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from . import _viable
from ._errors import InputError
from ._program import format_value


class Batch(_viable.Batch):
    """Many arms of one robot, each with its limits up to jerk, for learning: actions in, guarded motion out.

        batch = viable.Batch(viable.Robot("panda"), n=4096, action="acceleration")
        batch.step(actions, substeps=10)     # actions (n, joints); 10 ticks of 1 ms
        batch.q, batch.qd                    # (n, joints), views that the next step changes

    Position, velocity, acceleration and jerk limits of every (nominal) arm hold at every tick and between, whatever the
    actions are: no cost signal is needed.

    robot      viable.Robot
    n          arms, up to 1,000,000
    tick       of each arm [s]
    limits     viable.Limits of all arms at first; None: the robot's. Each arm its own: change_limits()
    action     torque [Nm], acceleration (M a + b is the torque) [rad/s^2], or target: a joint target that rests, led to as
               fast as the limits allow [rad]; tool_pose, (n, 7): the tool's position [m] and quaternion x, y, z, w in the base
               frame, led to as the controller tool_servo does; tool_position, (n, 3): the same, the orientation is free
    k_alpha, gamma, recovery, objective   as of viable.Guard
    environment   what stands around each arm, as `environment` of an experiment file:
               {"obstacles": {"table": {"box": [1, 1, 0.1], "at": {"xyz": [0.5, 0, -0.05]}}}}; {}: nothing but itself. Then the
               arms keep clear of it and of themselves (whole_arm_braking): `clearance`, and status limited where they brake
               before something. Up to fifteen times the work, 0.7 MB an arm. Moving spheres have each arm's own time, since its reset. None: not
               looked at
    plant      a simulated real arm behind each nominal one, as `real_plant` of an experiment file, drawn anew for each arm where
               a value is a draw: {"payload_kg": "~uniform(0, 2)", "friction_scale": "~uniform(0.5, 1.5)"}. The plugin is
               simbody with the dynamics recursion where nothing else is said. A robust loop keeps it next to the nominal arm;
               one that does not follow is not stopped: look at real_q - q. None: nominal arms alone, four times as fast
    seed       of those draws
    threads    at most so many; 0: one per core

    All state is float64, row i is arm i; the arrays are read-only views: copy what is to be kept. One thread at a time.
    """

    def __init__(self, robot: _viable.Robot, n: int = 4096, tick: float = 0.001, *, limits: _viable.Limits | None = None,
                 action: str = "torque", k_alpha: float = math.inf, gamma: float = 20.0, recovery: bool = False,
                 objective: str = "torque", environment: Mapping[str, Any] | None = None, plant: Mapping[str, Any] | None = None,
                 seed: int = 1, threads: int = 0) -> None:
        block = ""
        if plant is not None:
            block = {"plugin": "simbody", **plant}
            if block["plugin"] == "simbody":
                block.setdefault("dynamics", "recursion")
            block = format_value(block)
        super().__init__(robot, n, tick, limits=limits, action=action, k_alpha=k_alpha, gamma=gamma, recovery=recovery,
                         objective=objective, environment="" if environment is None else format_value(environment), plant=block,
                         seed=seed, threads=threads)
        self.robot = robot
        self._keeps_clear = environment is not None

    def random_poses(self, rng: np.random.Generator, mask: Any = None, share: float = 0.8) -> np.ndarray:
        """Places drawn evenly from the middle `share` of the position limits (+-pi where there is none), a row for each arm of
        the mask; with an environment those where nothing is too near: raises viable.InputError where 1000 draws find none."""
        arms = np.array(self._take_arms(mask), int)
        if len(arms) == 0:
            return np.zeros((0, self.joints))
        bounds = np.array([self.limits(int(arm)).position for arm in arms])
        lower = np.where(np.isfinite(bounds[:, 0]), bounds[:, 0], -np.pi)
        upper = np.where(np.isfinite(bounds[:, 1]), bounds[:, 1], np.pi)
        middle, half = (lower + upper) / 2, share * (upper - lower) / 2
        return self._draw(rng, arms, middle - half, middle + half)

    def _draw(self, rng: np.random.Generator, arms: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        """A row for each of `arms` between its rows of `lower` and `upper`, where nothing is too near."""
        middle, half = (lower + upper) / 2, (upper - lower) / 2
        poses = middle + half * rng.uniform(-1, 1, middle.shape)
        if not self._keeps_clear:
            return poses
        open_ = np.array(self._find_unusable(arms, poses), int)
        for _ in range(1000):
            if len(open_) == 0:
                return poses
            poses[open_] = middle[open_] + half[open_] * rng.uniform(-1, 1, (len(open_), self.joints))
            open_ = open_[self._find_unusable(arms[open_], poses[open_])]
        raise InputError("Batch.random_poses", f"of 1000 poses of arm {arms[open_[0]]} each is too near to something",
                            "Look at the environment and its safety_distance_m.")

    def random_reset(self, rng: np.random.Generator, mask: Any = None, share: float = 0.8) -> None:
        """Puts arms at rest to random_poses(rng, mask, share)."""
        arms = self._take_arms(mask)
        self.reset(arms, self.random_poses(rng, arms, share))
