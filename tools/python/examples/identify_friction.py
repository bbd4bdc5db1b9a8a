"""Joint friction from a CSV of positions and torques. Usage: identify_friction.py FILE.csv ROBOT

Columns: time_s, then JOINT_rad and JOINT_Nm of each joint, as of any logger; torques are held from row to row."""

import sys

import numpy as np

import viable
from picture import draw

if len(sys.argv) < 3:
    sys.exit(__doc__)
file, robot = sys.argv[1], viable.Robot(sys.argv[2])
found = viable.identify(file, robot=robot.folder, payload="mass")
speed = np.linspace(-1, 1, 401)
with draw("identify_friction.png") as axes:
    for name, joint in found["joints"].items():
        if joint["form"] != "saturating":
            print(f"{name}: {joint['reason'] or joint['form']}")
            continue
        coulomb, viscous, at = (joint[key]["value"] for key in ("coulomb_Nm", "viscous_Nm", "viscous_velocity_radps"))
        print(f"{name}: Coulomb {coulomb:.2f} Nm, viscous {viscous:.2f} Nm over {at:.2f} rad/s")
        axes.plot(speed, np.sign(speed) * (coulomb + viscous * (1 - np.exp(-abs(speed) / at))), label=name)
    axes.set(xlabel="velocity [rad/s]", ylabel="friction [Nm]")
    axes.legend()
