"""A random policy on many arms, guarded: no limit is broken. Usage: random_policy.py [ARMS [STEPS]]"""

import sys
import time

import numpy as np

import viable
from picture import draw

arms, steps = int(sys.argv[1]) if len(sys.argv) > 1 else 4096, int(sys.argv[2]) if len(sys.argv) > 2 else 200
robot = viable.Robot("panda")
batch = viable.Batch(robot, arms, action="acceleration")
rng = np.random.default_rng(0)
batch.random_reset(rng)
lower, upper = robot.limits.position
path, seconds, use = [], 0.0, np.zeros(4)
for _ in range(steps):
    actions = rng.uniform(-30, 30, batch.q.shape)
    begin = time.process_time()
    batch.step(actions, substeps=10)
    seconds += time.process_time() - begin
    path.append(batch.q[:20].copy())
    bounds = (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)
    shares = [abs(values / bound[1]).max() for values, bound in zip((batch.qd, batch.qdd, batch.jerk), bounds)]
    position = np.maximum(batch.q - upper, lower - batch.q).max()
    use = np.maximum(use, [1 + position, *shares])
print(f"{arms * steps * 10 / seconds:.3g} arm-ticks per second of one core; largest use of velocity, acceleration and jerk limit "
      + ", ".join(f"{100 * each:.2f} %" for each in use[1:]) + f"; nearest to a position limit {1 - use[0]:.2g} rad")
with draw("random_policy.png") as axes:
    axes.plot(np.arange(steps) * 0.01, np.array(path)[:, :, 1], linewidth=0.7)
    axes.axhline(lower[1], color="k")
    axes.axhline(upper[1], color="k")
    axes.set(xlabel="time [s]", ylabel=f"{robot.joints[1]} of 20 arms [rad]")
