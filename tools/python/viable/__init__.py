"""Joint limits up to jerk for torque-controlled robot arms.

    Robot, Limits, Dynamics      what an arm is and may do
    Guard, ReferenceGuard        limits around a torque law, or around joint targets
    Servo                        the fastest way to a joint target within limits, as jerks
    Batch                        thousands of guarded arms at once, for learning
    Log                          the log of a run as numpy arrays
    Stream                       targets for an arm that `viable live` drives
    run, verify, identify, ...   what the program `viable` does, results as dicts; find_program() tells where it is
    Error, InputError            what goes wrong: place, cause, remedy, kind

Arrays are float64 with one number per joint, base first; units are rad, s and Nm (of joints that slide m and N).
"""

from ._batch import Batch
from ._errors import Error, InputError
from ._log import Log
from ._paths import find_program
from ._program import bound, identify, run, sweep, verify
from ._stream import Stream
from ._types import STATUS, State
from ._viable import ACTING, Dynamics, Guard, Limits, ReferenceGuard, Robot, Servo, __version__

__all__ = [
    "ACTING", "Batch", "Dynamics", "Error", "Guard", "InputError", "Limits", "Log", "ReferenceGuard", "Robot", "Servo", "STATUS", "State",
    "Stream", "bound", "find_program", "identify", "run", "sweep", "verify", "__version__",
]
