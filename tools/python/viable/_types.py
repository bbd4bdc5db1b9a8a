"""Plain types."""

from typing import NamedTuple

import numpy as np


class State(NamedTuple):
    """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] of the joints, each (n,)."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


#: What Batch.status counts by.
STATUS = ("not_started", "passed", "limited", "recovering", "waiting", "stopping", "stopped", "failed")
