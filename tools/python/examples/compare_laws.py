"""Three limit laws on one task: who breaks what, and a picture of the jerk. Usage: compare_laws.py EXPERIMENT [SECONDS]"""

import sys
import tempfile

import viable
from picture import draw

if len(sys.argv) < 2:
    sys.exit(__doc__)
experiment, seconds = sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 30
laws = {"C1": "acceleration viability", "C2": "tosbp", "C3": "certified braking"}
with tempfile.TemporaryDirectory() as folder:
    summary = viable.run(experiment, cases=list(laws), set={"duration_s": seconds}, out=f"{folder}/run")
    logs = {case: viable.Log(f"{folder}/run/{case}.mcap") for case in laws}
    for case, law in laws.items():
        jerk = abs(logs[case].joint_array("nominal", "jerk_radps3")).max()
        print(f"{law:24} largest jerk {jerk:9.1f} rad/s^3   {summary['cases'][case]['verdict'].split(';')[0]}")
    with draw("compare_laws.png") as axes:
        for case, law in reversed(laws.items()):
            axes.plot(logs[case]["time_s"], logs[case]["nominal.joint2.jerk_radps3"], label=law, linewidth=0.8)
        axes.set(xlabel="time [s]", ylabel="jerk of joint2 [rad/s$^3$]", yscale="symlog")
        axes.legend()
