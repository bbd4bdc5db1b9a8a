"""A law in Python beside a compiled one: who keeps which limit, and what a tick takes. Usage: try_law.py [SECONDS]"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import viable
from picture import draw

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10
with tempfile.TemporaryDirectory() as folder:
    summary = viable.run(Path(__file__).with_name("my_law.yaml"), set={"duration_s": seconds}, out=f"{folder}/run")
    logs = {case: viable.Log(f"{folder}/run/{case}.mcap") for case in summary["cases"]}
    for case, log in logs.items():
        tick = np.median(log["tick.filter_us"])
        print(f"{case:10} {tick:6.1f} us in the filter   {summary['cases'][case]['verdict']}")
    with draw("try_law.png") as axes:
        for case, log in logs.items():
            axes.plot(log["time_s"], log.joint_array("nominal", "qd_radps")[:, 1], label=case, linewidth=0.8)
        axes.set(xlabel="time [s]", ylabel="velocity of joint2 [rad/s]")
        axes.legend()
