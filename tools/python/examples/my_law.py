"""A safety filter to try out: hurries to the velocity that the controller wants, and slows down before a position limit."""

import numpy as np


class SlowDown:
    """Holds accelerations: a jerk limit is not kept, which the table of the run shows."""

    holds = "acceleration"

    def __init__(self, share=0.8):
        if not 0 < share <= 1:
            raise ValueError("share of the limits that may be used: above 0, up to 1")
        self.share = share

    def configure(self, setup):
        """setup: joints (names), tick [s], limits.position, .velocity, .acceleration, .jerk (each (2, n): lower, upper), start, ..."""
        self.tick = setup.tick
        self.lower, self.upper = setup.limits.position
        self.fastest = self.share * setup.limits.velocity[1]
        self.strongest = self.share * setup.limits.acceleration[1]

    def filter(self, nominal, torque, dynamics):
        """nominal: q, qd, qdd (n,); torque (n,) [Nm]; dynamics: M (n, n), b, gravity (n,), J (6, n), tool (4, 4)"""
        wanted = np.linalg.solve(dynamics.M, torque - dynamics.b)
        # The fastest velocity from which half of the acceleration stops before the limit.
        room = np.maximum(np.stack([nominal.q - self.lower, self.upper - nominal.q]), 0)
        slowest, fastest = np.sqrt(self.strongest * room) * [[-1], [1]]
        qd = np.clip(nominal.qd + self.tick * wanted, np.maximum(slowest, -self.fastest), np.minimum(fastest, self.fastest))
        return np.clip((qd - nominal.qd) / self.tick, -self.strongest, self.strongest)
