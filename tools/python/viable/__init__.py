"""Joint limits up to jerk for torque-controlled robot arms.

    Robot, Limits, Dynamics      what an arm is and may do
    Guard, ReferenceGuard        limits around a torque law, or around joint targets
    Log                          the log of a run as numpy arrays
    run, verify, identify, ...   what the program `viable` does, results as dicts
    Error, InputError            what goes wrong: place, cause, remedy, kind

Arrays are float64 with one number per joint, base first; units are rad, s and Nm (of joints that slide m and N).
"""

from ._errors import Error, InputError
from ._log import Log
from ._program import bound, identify, run, sweep, verify
from ._types import State
from ._viable import Dynamics, Guard, Limits, ReferenceGuard, Robot, __version__

__all__ = [
    "Dynamics", "Error", "Guard", "InputError", "Limits", "Log", "ReferenceGuard", "Robot", "State",
    "bound", "identify", "run", "sweep", "verify", "__version__",
]
