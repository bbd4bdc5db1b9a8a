"""Many guarded arms at once."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np

from . import _viable
from ._errors import InputError


class Batch(_viable.Batch):
    """Many arms of one robot, each with its limits up to jerk, for learning: actions in, guarded motion out.

        batch = viable.Batch(viable.Robot("panda"), n=4096, action="acceleration")
        batch.step(actions, substeps=10)     # actions (n, joints); 10 ticks of 1 ms
        batch.q, batch.qd                    # (n, joints), views that the next step changes

    Position, velocity, acceleration and jerk limits of every (nominal) arm hold at every tick and between, whatever the
    actions are: no cost signal is needed.

    With an environment, such as {"obstacles": {"table": {"box": [1, 1, 0.1], "at": {"xyz": [0.5, 0, -0.05]}}}}, the arms keep clear
    of it and of themselves (whole_arm_braking): `clearance`, and status limited where they brake before something. Up to fifteen
    times the work, 0.6 MB an arm. Moving spheres have each arm's own time, since its reset.

    A plant is drawn anew for each arm where a value is a draw: {"payload_kg": "~uniform(0, 2)", "friction_scale":
    "~uniform(0.5, 1.5)"}. The plugin is simbody with the dynamics recursion where nothing else is said. A robust loop keeps it next
    to the nominal arm; one that does not follow is not stopped: look at real_q - q.

    All state is float64, row i is arm i; the arrays are read-only views: copy what is to be kept. One thread at a time.

    Keywords, beside robot (viable.Robot), n (arms, up to 1,000,000) and tick (of each arm [s]):
    """

    __doc__ = inspect.cleandoc(__doc__ or "") + "\n\n" + _viable.Batch.__doc__.partition("\n\n")[2]  # `or`: python -OO

    def random_poses(self, rng: np.random.Generator, mask: Any = None, share: float = 0.8) -> np.ndarray:
        """Places drawn evenly from the middle `share` of the position limits (+-pi where there is none), a row for each arm of
        the mask; with an environment those where nothing is too near, also with recovery: raises viable.InputError where 1000 draws find none."""
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
        open_ = np.array(self._find_unusable(arms, poses) if self._keeps_clear else [], int)
        for _ in range(999):
            if len(open_) == 0:
                break
            poses[open_] = middle[open_] + half[open_] * rng.uniform(-1, 1, (len(open_), self.joints))
            open_ = open_[self._find_unusable(arms[open_], poses[open_])]
        if len(open_) > 0:
            raise InputError("Batch.random_poses", f"of 1000 poses of arm {arms[open_[0]]} each is too near to something",
                             "Look at the environment and its safety_distance_m.")
        return poses

    def random_reset(self, rng: np.random.Generator, mask: Any = None, share: float = 0.8) -> None:
        """Puts arms at rest to random_poses(rng, mask, share)."""
        arms = self._take_arms(mask)
        self.reset(arms, self.random_poses(rng, arms, share))
