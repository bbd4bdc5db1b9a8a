"""How many arms a batch moves: arm-ticks per second of one core, how much two threads gain, memory per arm.

One thread and two take turns, step by step, and the fastest tenth of the steps counts: others may be on the machine. By the clock
two threads gain what the column `two threads` says, as long as two cores are free; `work` is the processor's time that they take for
the same steps, as a share of one thread's: 1.00 where nothing is lost to each other.
Usage: throughput.py [ARMS [SECONDS]]: arms of each batch (of those among obstacles a sixty-fourth), seconds of each measurement"""

import json
import os
import sys
import time

import numpy as np

import viable

ARMS, SECONDS = int(sys.argv[1]) if len(sys.argv) > 1 else 4096, float(sys.argv[2]) if len(sys.argv) > 2 else 5.0
TICKS = 10
ROBOT = viable.Robot("indy7")
PLANT = {"payload_kg": "~uniform(0, 2)", "friction_scale": "~uniform(0.5, 1.5)"}
AROUND = {"obstacles": {"table": {"box": [1.6, 1.2, 0.04], "at": {"xyz": [0.2, 0, -0.06]}},
                        "pillar": {"cylinder": {"radius": 0.06, "length": 1.6}, "at": {"xyz": [0.35, 0.45, 0.7]}}}}
FEW = max(ARMS // 64, 2)


def push(batch, rng):
    """Torques far beyond what the limits allow, so that they hold each joint back."""
    return rng.choice([-1e3, 1e3], (len(batch), 6))


def rest(batch, rng):
    """Torques that no limit minds."""
    return np.tile(ROBOT.dynamics(ROBOT.home).gravity, (len(batch), 1))


def aim(batch, rng):
    return ROBOT.home + rng.uniform(-1, 1, (len(batch), 6))


def reach(batch, rng):
    poses = np.zeros((len(batch), 7))
    for pose in poses:
        tool = ROBOT.dynamics(ROBOT.home + rng.uniform(-0.5, 0.5, 6)).tool
        pose[:3] = tool[:3, 3]
    poses[:, 3:] = np.tile(START[3:], (len(batch), 1))
    return poses[:, :batch.action_size]


START = viable.Batch(ROBOT, 1).tool_pose()[0]
KINDS = {
    "torque, nothing acts": (ARMS, rest, {}),
    "torque, all joints limited": (ARMS, push, {}),
    "target (servo)": (ARMS, aim, {"action": "target"}),
    "tool_position (tool servo)": (ARMS, reach, {"action": "tool_position"}),
    "tool_pose (tool servo)": (ARMS, reach, {"action": "tool_pose"}),
    "torque, all limited, plant": (ARMS, push, {"plant": PLANT}),
    "torque, all limited, obstacles": (FEW, push, {"environment": AROUND}),
    "tool_pose, obstacles": (FEW, reach, {"action": "tool_pose", "environment": AROUND}),
}


def find_memory():
    """Of this process [kB]."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1024


def measure(arms, draw, options):
    """Of one kind, in a process of its own: arm-ticks / s and core, gain of a second thread, the work of two threads as a share,
    kB per arm, share of joints held."""
    before = find_memory()
    one = viable.Batch(ROBOT, arms, threads=1, **options)
    memory = (find_memory() - before) / arms
    batches = [one, viable.Batch(ROBOT, arms, threads=2, **options)]
    rng = np.random.default_rng(1)
    actions = [draw(one, rng) for _ in range(8)]
    wall, work, held, rounds = [[], []], [[], []], [], 0
    end = time.perf_counter() + SECONDS
    while time.perf_counter() < end or rounds < 3:
        for k, batch in enumerate(batches):  # one thread, two threads, in turn
            begin, used = time.perf_counter(), time.process_time()
            batch.step(actions[rounds // 10 % 8], TICKS)
            wall[k].append(time.perf_counter() - begin)
            work[k].append(time.process_time() - used)
        held.append((one.acting != 0).mean())
        rounds += 1
    assert (one.q == batches[1].q).all(), "the number of threads made a difference"
    wall, work = ([np.quantile(each, 0.1) for each in both] for both in (wall, work))
    return arms * TICKS / work[0], wall[0] / wall[1], work[1] / work[0], memory, np.mean(held)


print("                                  arm-ticks/s      two         kB per  joints")
print("                                     and core  threads   work     arm    held")
for name, kind in KINDS.items():
    ours, theirs = os.pipe()
    if os.fork() == 0:
        try:
            os.write(theirs, json.dumps([float(each) for each in measure(*kind)]).encode())
        finally:
            os._exit(0)
    os.close(theirs)
    with os.fdopen(ours) as answer:
        rate, gain, work, memory, held = json.loads(answer.read())
    os.wait()
    print(f"{name:33} {rate:12.0f} {gain:8.2f} {work:6.2f} {memory:7.0f} {100 * held:5.0f} %", flush=True)
