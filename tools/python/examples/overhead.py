"""What calls from Python cost, in us: the fastest of 7 series."""

import time

import numpy as np

import viable

robot = viable.Robot("indy7")
home, rest = robot.home, np.zeros(6)
torque = robot.dynamics(home).gravity
guard = viable.Guard(robot)
reference = viable.ReferenceGuard(robot)
batch = viable.Batch(robot, 1)
row = torque[None, :]
single = torque.astype(np.float32)

CALLS = {
    "len(guard): a call alone": lambda: len(guard),
    "guard.nominal: three arrays": lambda: guard.nominal,
    "robot.dynamics(q, qd)": lambda: robot.dynamics(home, rest),
    "guard.step(q, qd, torque)": lambda: guard.step(home, rest, torque),
    "the same with float32": lambda: guard.step(home, rest, single),
    "guard.step(q, qd, law), the law gives an array": lambda: guard.step(home, rest, lambda q, qd, d: torque),
    "the same, d.M @ (spring and damper) + d.b": lambda: guard.step(
        home, rest, lambda q, qd, d: d.M @ (100 * (home - q) - 20 * qd) + d.b),
    "reference.step(target)": lambda: reference.step(home),
    "batch.step(actions, 1) of one arm": lambda: batch.step(row, 1),
}

for name, call in CALLS.items():
    fastest = float("inf")
    for _ in range(7):
        guard.start(home)  # at rest again
        reference.start(home)
        batch.reset()
        begin = time.perf_counter()
        for _ in range(1000):
            call()
        fastest = min(fastest, (time.perf_counter() - begin) / 1000)
    assert guard.stop_reason == "none", guard.stop_message
    print(f"{1e6 * fastest:8.2f}  {name}")
