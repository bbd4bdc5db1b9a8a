"""An arm that `viable live` drives at 1 kHz follows targets from Python at 30 Hz. Usage: live_stream.py [SECONDS]

Starts the program itself, with stream.yaml beside this file; you would start it in a terminal of its own. The socket has a name
of its own, too: under that of stream.yaml another arm may listen, which is not to move."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import viable
from picture import draw

RATE = 30  # Hz
seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10
rng = np.random.default_rng(3)
with tempfile.TemporaryDirectory() as folder:
    name = f"live-stream-{os.getpid()}"
    live = subprocess.Popen([viable.find_program(), "live", Path(__file__).with_name("stream.yaml"), "--set", f"command.name={name}",
                             "--out", f"{folder}/run", "--duration", str(seconds + 1), "--no-report"], stdout=subprocess.DEVNULL)
    try:
        with viable.Stream(name) as stream:
            target = home = viable.Robot("indy7").home
            ages = []
            begin = time.monotonic()
            for k in range(int(seconds * RATE)):
                if live.poll() is not None:
                    sys.exit(f"viable live has ended early, with {live.returncode}")
                if k % RATE == 0:  # a policy that changes its mind once a second
                    target = home + rng.uniform(-0.8, 0.8, len(home))
                stream.send(target)
                ages.append(stream.age)
                time.sleep(max(0, begin + (k + 1) / RATE - time.monotonic()))
        assert live.wait() == 0
    finally:  # whatever happened here: no arm is left behind
        live.terminate()
        live.wait()
    log = viable.Log(f"{folder}/run/arm.mcap")
    t, command, q = log["time_s"], log.joint_array("command", "q_rad"), log.joint_array("real", "q_rad")
    print(f"{stream.counts['taken']} targets taken, {stream.counts['stale']} stale; age {1e3 * np.nanmedian(ages):.2f} ms in the median, "
          f"{1e3 * np.nanmax(ages):.2f} ms at most")
    jerk = abs(log.joint_array("nominal", "jerk_radps3")).max()
    print(f"largest jerk {jerk:.2f} of {12 * np.pi:.2f} rad/s^3; {int(log['tick.missed'].sum())} of {len(t)} ticks missed")
    with draw("live_stream.png") as axes:
        axes.step(t, command[:, 1], where="post", label="target", linewidth=0.8)
        axes.plot(t, q[:, 1], label="arm")
        axes.set(xlabel="time [s]", ylabel="joint2 [rad]")
        axes.legend()
