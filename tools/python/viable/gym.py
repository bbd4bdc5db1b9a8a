"""Environments for Gymnasium (1.1 and newer), which must be installed: `import viable.gym` registers `viable/Reach-v0`."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from ._batch import Batch
from ._errors import InputError
from ._types import STATUS
from ._viable import Limits, ReferenceGuard, Robot

try:
    import gymnasium
except ImportError as error:
    raise ImportError("viable.gym needs Gymnasium 1.1 or newer: pip install gymnasium") from error

ACTIONS = ("torque", "acceleration", "target", "tool")
AUTORESETS = ("next_step", "same_step", "disabled")


class ReachVectorEnv(gymnasium.vector.VectorEnv):
    """Arms that move their tools to goals, each arm's limits up to jerk guaranteed: no action breaks a constraint.

        env = gymnasium.make_vec("viable/Reach-v0", num_envs=4096, robot="panda")    # or viable.gym.ReachVectorEnv(...)
        observations, infos = env.reset(seed=1)
        observations, rewards, terminations, truncations, infos = env.step(env.action_space.sample())

    Observation, float32: positions as shares of their limits (-1 to 1; joints without: sine), velocities as shares of their limits,
    and the way from tool to goal [m]: 2 n + 3 numbers. With a plant all of it is of the real arms, as measured.
    Action, -1 to 1, n numbers: a share of the motors' torque limits (torque), of the acceleration limits or, for
    action="target", of the position limits; 3 numbers for action="tool": where the tool shall go, as a share of the box `places`
    that holds the tool's places at random poses. Beyond that range it is cut; an arm with NaN in its action brakes.
    Reward: minus the distance of the tool from the goal [m]. Terminated: it is within `reach` [m]. Truncated: after `horizon` steps,
    or its plant failed. With a plant the tool is that of the real arm, as measured: where that lags behind the nominal one, so do
    reward and end.
    Goals are the tool's places at random poses. All that is random follows from the seed of reset().
    infos: `limited`, (num_envs,) of truths: the guard changed what the action asked for, or braked as it was of no use; `_limited`: false where an arm has just
    begun and took no action.

    autoreset   what becomes of an arm that has ended, as in Gymnasium's AutoresetMode:
                next_step   it begins anew in the next step, whose action it ignores: with its first observation, reward 0, no end
                same_step   it begins anew in the very step: the observation is its first one, that of its end is
                            infos["final_obs"][arm] where infos["_final_obs"] is true, else None; infos["final_info"] has its
                            `limited`
                disabled    it waits for reset(options={"reset_mask": mask}), (num_envs,) of truths; a step before that raises
    robot      a viable.Robot or its name
    substeps   ticks of `tick` seconds that an action holds
    limits, environment, plant, threads   as of viable.Batch
    """

    def __init__(self, robot: Robot | str = "panda", num_envs: int = 1024, *, action: str = "acceleration", substeps: int = 10,
                 horizon: int = 300, reach: float = 0.05, tick: float = 0.001, limits: Limits | None = None,
                 environment: Mapping[str, Any] | None = None, plant: Mapping[str, Any] | None = None, threads: int = 0,
                 autoreset: str = "next_step") -> None:
        if action not in ACTIONS:
            raise InputError("ReachVectorEnv: action", f"`{action}`", "It is torque, acceleration or target, or tool.")
        if autoreset not in AUTORESETS:
            raise InputError("ReachVectorEnv: autoreset", f"`{autoreset}`", "It is next_step, same_step or disabled.")
        self.robot = Robot(robot) if isinstance(robot, str) else robot
        self.batch = Batch(self.robot, num_envs, tick, limits=limits, action="tool_position" if action == "tool" else action,
                           environment=environment, plant=plant, threads=threads)
        self.num_envs, self.substeps, self.horizon, self.reach = num_envs, substeps, horizon, reach
        bounds = self.batch.limits()
        n = len(self.robot)
        if action == "torque":
            self._upper = self.robot.torque_limit
            if not np.isfinite(self._upper).all():
                raise InputError("ReachVectorEnv: action", "`torque`: the robot does not say how much its motors can",
                                 "Give torque_limit_Nm in its actuation.yaml, or use acceleration.")
            self._lower = -self._upper
        elif action == "acceleration":
            self._lower, self._upper = np.maximum(bounds.acceleration[0], -1e3), np.minimum(bounds.acceleration[1], 1e3)
        elif action == "target":
            self._lower, self._upper = np.maximum(bounds.position[0], -np.pi), np.minimum(bounds.position[1], np.pi)
        else:
            self._lower, self._upper = self._find_places(bounds)
        self._positions, self._fastest = bounds.position, np.minimum(np.maximum(-bounds.velocity[0], bounds.velocity[1]), 1e3)
        self._is_bounded = np.isfinite(self._positions).all(axis=0)
        box = gymnasium.spaces.Box
        self.single_action_space = box(-1.0, 1.0, self._lower.shape, np.float32)
        self.action_space = box(-1.0, 1.0, (num_envs, *self._lower.shape), np.float32)
        self.single_observation_space = box(-np.inf, np.inf, (2 * n + 3,), np.float32)
        self.observation_space = box(-np.inf, np.inf, (num_envs, 2 * n + 3), np.float32)
        self.metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode[autoreset.upper()]}
        self.goals = np.zeros((num_envs, 3))
        self._autoreset = autoreset
        self._steps = np.zeros(num_envs, int)
        self._ended = np.zeros(num_envs, bool)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """All arms begin anew; with options={"reset_mask": mask}, (num_envs,) of truths, those of it, and the others stand as
        they are."""
        super().reset(seed=seed, options=options)
        which = np.ones(self.num_envs, bool)
        if options is not None and "reset_mask" in options:
            which = np.asarray(options["reset_mask"])
            if which.dtype != bool or which.shape != (self.num_envs,):
                raise InputError("ReachVectorEnv.reset: reset_mask", f"the array has shape {which.shape} and type {which.dtype}",
                                 f"Give truths, shape ({self.num_envs},).")
        self._begin(which)
        return self._observe()[0], {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        actions = np.asarray(actions, float)
        if actions.shape != self.action_space.shape:
            raise InputError("ReachVectorEnv.step", f"the array has shape {actions.shape}",
                             f"Give a row per arm, shape {self.action_space.shape}.")
        begun = self._ended.copy()
        if self._autoreset == "disabled" and begun.any():
            raise InputError("ReachVectorEnv.step", f"arm {np.flatnonzero(begun)[0]} has ended and was not reset",
                             'Call reset(options={"reset_mask": terminations | truncations}) first.')
        shares = (np.clip(actions, -1.0, 1.0) + 1.0) / 2.0
        self.batch.step(self._lower + shares * (self._upper - self._lower), self.substeps)
        limited = ((self.batch.acting != 0).any(axis=1) | (self.batch.status == STATUS.index("waiting"))) & ~begun
        failed = self.batch.status == STATUS.index("failed")  # stands until its reset
        self._steps += 1
        if begun.any():
            self._begin(begun)
        observations, distances = self._observe()
        terminations = (distances < self.reach) & ~failed & ~begun
        truncations = ((self._steps >= self.horizon) | failed) & ~terminations & ~begun
        rewards = np.where(begun, 0.0, -distances)
        infos = {"limited": limited, "_limited": ~begun}
        ended = terminations | truncations
        if self._autoreset == "same_step" and ended.any():
            final = np.full(self.num_envs, None, object)
            for arm in np.flatnonzero(ended):
                final[arm] = observations[arm]
            infos.update(final_obs=final, _final_obs=ended, final_info={"limited": limited & ended, "_limited": ended},
                         _final_info=ended)
            self._begin(ended)
            observations = self._observe()[0]
        else:
            self._ended = ended
        return observations, rewards, terminations, truncations, infos

    @property
    def places(self) -> np.ndarray:
        """(2, 3): the lower and the upper corner of the box of action="tool", base frame [m]."""
        return np.array(self._find_places(self.batch.limits()))

    def _find_places(self, bounds: Limits) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = np.maximum(bounds.position[0], -np.pi), np.minimum(bounds.position[1], np.pi)
        poses = np.random.default_rng(0).uniform(lower, upper, (1000, len(lower)))
        tools = np.array([self.robot.dynamics(q).tool[:3, 3] for q in poses])
        return tools.min(axis=0), tools.max(axis=0)

    def _begin(self, which: np.ndarray) -> None:
        """Puts arms to random places at rest, and their goals elsewhere."""
        rng = self.np_random
        self.batch.random_reset(rng, which)
        arms = np.flatnonzero(which)
        lower, upper = np.maximum(self._positions[0], -np.pi), np.minimum(self._positions[1], np.pi)
        there = (len(arms), 1)
        for arm, q in zip(arms, self.batch._draw(rng, arms, np.tile(lower, there), np.tile(upper, there))):
            self.goals[arm] = self.robot.dynamics(q).tool[:3, 3]
        self._steps[which] = 0
        self._ended = self._ended & ~which

    def _observe(self) -> tuple[np.ndarray, np.ndarray]:
        """The observations, and how far the tools are from their goals [m]."""
        batch = self.batch
        is_real = batch.real_q is not None
        q, qd = (batch.real_q, batch.real_qd) if is_real else (batch.q, batch.qd)
        with np.errstate(invalid="ignore"):
            middle, half = self._positions.mean(axis=0), np.ptp(self._positions, axis=0) / 2
            shares = np.where(self._is_bounded, (q - middle) / half, np.sin(q))
        way = self.goals - batch.tool_position(is_real)
        return np.hstack([shares, qd / self._fastest, way]).astype(np.float32), np.linalg.norm(way, axis=1)


class ReachEnv(gymnasium.Env):
    """One arm of a ReachVectorEnv, with its arguments but num_envs and autoreset: gymnasium.make("viable/Reach-v0", robot="panda").

    `arms` is that ReachVectorEnv. infos: `limited`.
    """

    metadata = {"render_modes": []}
    render_mode = None

    def __init__(self, robot: Robot | str = "panda", **options: Any) -> None:
        self.arms = ReachVectorEnv(robot, 1, autoreset="disabled", **options)
        self.observation_space, self.action_space = self.arms.single_observation_space, self.arms.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.arms._np_random = self.np_random
        return self.arms.reset()[0][0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        observations, rewards, terminations, truncations, infos = self.arms.step(np.asarray(action)[None])
        return observations[0], float(rewards[0]), bool(terminations[0]), bool(truncations[0]), {"limited": bool(infos["limited"][0])}


_stepping: dict[int, GuardedActions] = {}  # the arms whose simulators step now, by the id of their MjData
_before: Any = None  # whose control callback stands when none of them steps
_lock = threading.Lock()


def _control(model: Any, data: Any) -> None:
    """MuJoCo's control callback, of all its models; none may be set while one is loaded."""
    if id(data) in _stepping:
        _stepping[id(data)]._control()


class GuardedActions(gymnasium.Wrapper):
    """Guards the arm of somebody else's environment on MuJoCo 3: what actions ask of its position servos goes through a
    viable.ReferenceGuard in every step of the simulator. So what the servos are told keeps position, velocity, acceleration and jerk
    limits, whatever the environment makes of its actions. Other actuators, as a gripper's, are left alone.

        names = {f"joint{i}": f"robot:panda0_joint{i}" for i in range(7)}    # of viable, of the model
        env = viable.gym.GuardedActions(gymnasium.make("FrankaKitchen-v1"), "panda", names)

    mapping   MuJoCo's joint of each joint of the robot, which count alike; each is moved by one position servo
    limits    None: the robot's, where the model's joints can go

    infos["guard"]: `reference`, what the servos are told, `q` and `qd`, the arm in the simulator, after the step [rad, rad/s];
    `position_excess` and `velocity_excess`, by how much it passed a limit there at worst (below 0: inside). That is what soft servos,
    weight and contacts add: narrower limits leave room for it. `guard` is the ReferenceGuard. reset() puts it where the arm is, at
    rest, and only what step() simulates is guarded: it takes MuJoCo's control callback meanwhile, and sets yours back.
    """

    def __init__(self, env: gymnasium.Env, robot: Robot | str, mapping: Mapping[str, str], *, limits: Limits | None = None) -> None:
        super().__init__(env)
        self.robot = Robot(robot) if isinstance(robot, str) else robot
        model, self._data = (getattr(env.unwrapped, name, None) for name in ("model", "data"))
        if not hasattr(model, "actuator_trnid"):
            raise InputError("GuardedActions: env", f"`{env.unwrapped}` has no MuJoCo model", "Its `model` and `data` are needed.")
        if set(mapping) != set(self.robot.joints):
            raise InputError("GuardedActions: mapping", f"it is for {', '.join(mapping)}", f"Map {', '.join(self.robot.joints)}.")
        if model.opt.integrator == 1:  # mjINT_RK4
            raise InputError("GuardedActions: env", "its integrator is RK4, whose stages are no steps of the guard",
                             "Set `model.opt.integrator` to Euler or implicitfast.")
        joints, servos = [], []
        for name in (mapping[joint] for joint in self.robot.joints):
            try:
                joints.append(model.joint(name).id)
            except KeyError as error:
                raise InputError("GuardedActions: mapping", f"the model has no joint `{name}`", "Look into its MJCF.") from error
            moving = np.flatnonzero((model.actuator_trnid[:, 0] == joints[-1]) & (model.actuator_trntype == 0))  # by joint
            bias, gain = model.actuator_biasprm[moving], model.actuator_gainprm[moving, 0]
            others = model.actuator_gaintype, model.actuator_dyntype  # neither fixed, nor without a state of its own
            if len(moving) != 1 or any(of[moving[0]] for of in others) or bias[0, 0] != 0 or bias[0, 1] != -gain[0] or gain[0] <= 0:
                raise InputError("GuardedActions: env", f"joint `{name}` is not moved by one position servo",
                                 "Others cannot be guarded here: use viable.Guard in a loop of your own.")
            servos.append(moving[0])
        self._servos, self._gears = np.array(servos), model.actuator_gear[servos, 0]
        force = np.abs(model.actuator_forcerange[servos]).max(axis=1) / model.actuator_gainprm[servos, 0]
        self._stretch = np.where(model.actuator_forcelimited[servos] != 0, force / np.abs(self._gears), np.inf)
        self._positions, self._speeds = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        if limits is None:
            (lower, upper), end = self.robot.limits.position, np.where(model.jnt_limited[joints] != 0, 0.0, np.inf)
            ranges = model.jnt_range[joints].T
            told = np.sort(model.actuator_ctrlrange[servos] / self._gears[:, None]).T
            all_told = np.where(model.actuator_ctrllimited[servos] != 0, 0.0, np.inf)
            limits = self.robot.limits.replace(position=(np.maximum.reduce([lower, ranges[0] - end, told[0] - all_told]),
                                                         np.minimum.reduce([upper, ranges[1] + end, told[1] + all_told])))
        self.guard = ReferenceGuard(self.robot, model.opt.timestep, limits=limits, between="hold", velocity_filter=np.inf, recovery=True)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        observation, infos = super().reset(**options)
        self._check_data()
        self.guard.start(self._data.qpos[self._positions])
        self._asked = self._told = self._data.ctrl[self._servos]
        self._time = -np.inf
        return observation, infos

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        self._check_data()
        self._worst = np.full(2, -np.inf)
        self._is_new = True  # what stands in the controls at the first call was asked for
        self._change(True)
        try:
            observation, reward, terminated, truncated, infos = super().step(action)
        finally:
            self._change(False)
        self._read()
        self._data.ctrl[self._servos] = self._asked  # the environment finds what it has put there
        q, qd = self._data.qpos[self._positions], self._data.qvel[self._speeds]
        guard = {"reference": self._told / self._gears, "q": q, "qd": qd,
                 "position_excess": self._worst[0], "velocity_excess": self._worst[1]}
        return observation, reward, terminated, truncated, {**infos, "guard": guard}

    def _check_data(self) -> None:
        if self.env.unwrapped.data is not self._data:
            raise InputError("GuardedActions: env", "its `data` is another one by now: it has built its simulation anew",
                             "Make a GuardedActions for that.")

    def _change(self, is_stepping: bool) -> None:
        import mujoco

        global _before
        with _lock:
            if is_stepping and id(self._data) in _stepping:
                raise InputError("GuardedActions: env", "another GuardedActions guards the same simulation", "Guard its arms as one robot.")
            if not _stepping:
                _before = mujoco.get_mjcb_control()
            _stepping.pop(id(self._data), None)
            if is_stepping:
                _stepping[id(self._data)] = self
            mujoco.set_mjcb_control(_control if _stepping else _before)

    def _control(self) -> None:
        """MuJoCo asks for the controls: once a step, or again at the same time."""
        controls = self._data.ctrl
        if self._is_new or (controls[self._servos] != self._told).any():
            self._asked, self._is_new = controls[self._servos], False
        if self._data.time != self._time:  # an environment may set it back
            self._time = self._data.time
            q = self._read()
            # Beyond these a servo pulls no harder: the reference of an arm that is held does not run away from it.
            target = np.clip(self._asked / self._gears, q - self._stretch, q + self._stretch)
            self._told = self.guard.step(target).q * self._gears
        controls[self._servos] = self._told

    def _read(self) -> np.ndarray:
        q, qd, limits = self._data.qpos[self._positions], self._data.qvel[self._speeds], self.guard.limits
        for i, (value, bounds) in enumerate(((q, limits.position), (qd, limits.velocity))):
            self._worst[i] = max(self._worst[i], (value - bounds[1]).max(), (bounds[0] - value).max())
        return q


gymnasium.register("viable/Reach-v0", entry_point=ReachEnv, vector_entry_point=ReachVectorEnv)
