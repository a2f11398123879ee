"""How the commanded velocity evolves in training.

Pure functions of arrays: no host synchronisation, no branch on a value, so that a whole training step
can be captured in one CUDA graph. Times are drawn once and counted down. Each schedule uses fixed columns
of the ``random`` argument ``(n, 8)``:

====== =========================================================
column draws
====== =========================================================
0, 1   target speed (or its place in its bin) and the kind of target
2, 3   target yaw rate (or its place in its bin) and whether there is one (or which bin)
4      time for which the targets persist
5, 6   command inside the neighbourhood, and whether it is biased
7      time for which the command holds, or the acceleration
====== =========================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from sprintlab.commands.curricula import Curriculum
from sprintlab.commands.grid import CommandGrid
from sprintlab.commands.profiles import BRAKING_WINDOW, PACE_WINDOW, self_paced
from sprintlab.commands.state import CommandState, limit_yaw_rate
from sprintlab.control.arrays import Array, clip, filled, namespace
from sprintlab.core.checks import check_interval, check_positive, check_range


class CommandStep(NamedTuple):
    """What a schedule is told about one policy step of ``n`` environments."""

    speed: Array  # present forward speed [m/s] (n,)
    dt: float  # time since the last step [s]
    lower: Array | float  # bottom of the speed range [m/s], scalar or 0-d array
    upper: Array | float  # top of the speed range [m/s], scalar or 0-d array
    friction: Array | float  # ground friction coefficient (n,)
    reset_mask: Array  # environments just reset (n,): target and command are redrawn at once
    random: Array  # uniform numbers in [0, 1) (n, 8)
    weights: Array | None = None  # weights of the grid curriculum's bins (rows, columns); None: no grid
    steady: Array | float = 1.0  # 1 in the fine-tuning phase, 0 before it; scalar or 0-d array


@dataclass(frozen=True, kw_only=True)
class TargetSampling:
    """How persistent targets are drawn."""

    persistence: tuple[float, float] = (3.0, 7.0)  # least and greatest time a target stays [s]
    top_share: float = 0.65  # share of the speed targets drawn from the top of the range
    top_fraction: float = 0.25  # the top of the range is [(1 - top_fraction) upper, upper]
    zero_share: float = 0.1  # share of the speed targets that are exactly zero
    backward_share: float = 0.0  # share of the speed targets drawn from the backward end of the range
    slow_share: float = 0.0  # share of the speed targets in [0, top_fraction upper], the bottom
    yaw_share: float = 0.5  # share of the draws with a yaw-rate target; the others are straight
    yaw_limit: float = 1.0  # greatest yaw-rate target [rad/s]
    turn_share: float = 1.0
    """Share of the friction that a commanded turn may use, ``|v w| <= turn_share mu g``; at the paper's 1
    nothing is left to run with."""
    scaled_turns: bool = False
    """A target is a share of the fastest turn that friction allows at the commanded speed. Clipped, as in the
    paper, nearly half of the turns near the top of the range use all of the friction, and small ones are
    rare."""
    grid: Curriculum | None = CommandGrid()
    """Curriculum from which the other targets are drawn; None: they are uniform over the range."""

    def __post_init__(self) -> None:
        check_interval("persistence", self.persistence, 0.0, unit="s")
        for field in ("top_share", "top_fraction", "zero_share", "backward_share", "slow_share", "yaw_share"):
            check_range(field, getattr(self, field), 0.0, 1.0)
        check_range("turn_share", self.turn_share, 0.0, 1.0)
        named = self.top_share + 1.0 - self._last_drawn
        check_range("top_share + zero_share + backward_share + slow_share", named, 0.0, 1.0)
        check_range("yaw_limit", self.yaw_limit, 0.0, float("inf"), "rad/s")

    @property
    def _last_drawn(self) -> float:
        """Kinds from here on are slow, backward or zero."""
        return 1.0 - self.zero_share - self.backward_share - self.slow_share

    def speed(self, random: Array, lower: Array | float, upper: Array | float) -> Array:
        """Speed targets [m/s] ``(n,)`` in ``[lower, upper]``, or zero."""
        xp = namespace(random)
        value, kind = random[:, 0], random[:, 1]
        top = upper * (1.0 - self.top_fraction + self.top_fraction * value)
        drawn = xp.where(kind < self.top_share, top, lower + (upper - lower) * value)
        drawn = xp.where(kind >= self._last_drawn, upper * self.top_fraction * value, drawn)
        drawn = xp.where(kind >= 1.0 - self.zero_share - self.backward_share, lower * value, drawn)
        return xp.where(kind >= 1.0 - self.zero_share, xp.zeros_like(drawn), drawn)

    def yaw_rate(self, random: Array) -> Array:
        """Yaw-rate targets [rad/s] ``(n,)``."""
        xp = namespace(random)
        turning = self.yaw_limit * (2.0 * random[:, 2] - 1.0)
        return xp.where(random[:, 3] < self.yaw_share, turning, xp.zeros_like(turning))

    def turn(self, target: Array, speed: Array, friction: Array | float) -> Array:
        """Commanded yaw rate [rad/s] ``(n,)`` for a target and a commanded speed: ``|v w| <= mu g``."""
        held = self.turn_share * friction
        if not self.scaled_turns:
            return limit_yaw_rate(target, speed, held)
        fastest = limit_yaw_rate(filled(self.yaw_limit, speed), speed, held)
        return target / max(self.yaw_limit, 1e-9) * fastest

    def draw(
        self, random: Array, lower: Array | float, upper: Array | float, weights: Array | None
    ) -> tuple[Array, Array]:
        """Speed targets [m/s] and yaw-rate targets [rad/s] ``(n,)``, from the grid where it has its share."""
        xp = namespace(random)
        speed, yaw_rate = self.speed(random, lower, upper), self.yaw_rate(random)
        if self.grid is None or weights is None:
            return speed, yaw_rate
        kind = random[:, 1]
        ours = (kind >= self.top_share) & (kind < self._last_drawn)
        places = xp.stack((random[:, 3], random[:, 0], random[:, 2]), axis=1)
        grid_speed, grid_yaw_rate = self.grid.draw(weights, places, lower, upper)
        return xp.where(ours, grid_speed, speed), xp.where(ours, grid_yaw_rate, yaw_rate)

    def advance(self, state: CommandState, step: CommandStep) -> tuple[CommandState, Array]:
        """Count the target timer down, redraw what ran out; returns the state and the mask redrawn."""
        xp = namespace(step.random)
        remaining = state.time_to_target - step.dt
        renewed = step.reset_mask | (remaining <= 0.0)
        speed, yaw_rate = self.draw(step.random, step.lower, step.upper, step.weights)
        return state._replace(
            target_speed=xp.where(renewed, speed, state.target_speed),
            target_yaw_rate=xp.where(renewed, yaw_rate, state.target_yaw_rate),
            time_to_target=xp.where(renewed, between(self.persistence, step.random[:, 4]), remaining),
        ), renewed


def between(interval: tuple[float, float], random: Array) -> Array:
    """Numbers of an interval ``(n,)`` from uniform ones in [0, 1)."""
    lowest, highest = interval
    return lowest + (highest - lowest) * random


def assemble_command(speed: Array, target_yaw_rate: Array, friction: Array | float) -> Array:
    """Command ``(n, 3)``: forward speed, no sideways speed, yaw rate with ``|v w| <= mu g``."""
    xp = namespace(speed)
    yaw_rate = limit_yaw_rate(target_yaw_rate, speed, friction)
    return xp.stack((speed, xp.zeros_like(speed), yaw_rate), axis=-1)


class Schedule(Protocol):
    """What moves commands: a frozen dataclass of numbers, so that a checkpoint can keep it."""

    @property
    def targets(self) -> TargetSampling:
        """How targets are drawn."""
        ...

    def advance(self, state: CommandState, step: CommandStep) -> CommandState:
        """The state one policy step later.

        Over arrays, without looking into a value: in training it is compiled for the GPU.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class TargetSchedule:
    """What schedules share: targets that persist. A subclass says how the command follows them."""

    targets: TargetSampling = TargetSampling()  # how targets are drawn

    def advance(self, state: CommandState, step: CommandStep) -> CommandState:
        """The state one policy step later."""
        lower, upper = self._range(step.lower, step.upper)
        step = step._replace(lower=lower, upper=upper)
        state, renewed = self.targets.advance(state, step)
        return self._follow(state, renewed, step)

    def _range(self, lower: Array | float, upper: Array | float) -> tuple[Array | float, Array | float]:
        """Where targets and commands may lie [m/s]."""
        return lower, upper

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        """The state with its new command; ``renewed``: whose target was just drawn ``(n,)``."""
        raise NotImplementedError

    def _commanded(self, state: CommandState, speed: Array, step: CommandStep, **others: Any) -> CommandState:
        """The state that commands a speed [m/s] ``(n,)`` within the range, and ``others`` of its fields."""
        within = clip(speed, step.lower, step.upper)
        turn = self.targets.turn(state.target_yaw_rate, within, step.friction)
        command = assemble_command(within, turn, step.friction)
        return state._replace(command=command, **others)


def ramped(state: CommandState, acceleration: Array, step: CommandStep) -> Array:
    """Speeds [m/s] ``(n,)`` on the way to the targets; a fresh environment starts from its present speed."""
    start = namespace(step.speed).where(step.reset_mask, step.speed, state.command[:, 0])
    change = acceleration * step.dt
    return clip(state.target_speed, start - change, start + change)


@dataclass(frozen=True, kw_only=True)
class AdaptiveSchedule(TargetSchedule):
    """Adaptive command scheduling (ACS) toward a persistent target.

    The paper draws the next command within ``window`` of the robot's present speed ``v``. Alone that is a
    random walk; here most updates take the point of the neighbourhood nearest to the target ``v*``:
    ``clip(v*, v - braking_window, v + window)``. The others are uniform within ``window``. Then clipped to
    the range.
    """

    window: float = PACE_WINDOW  # half width of the neighbourhood [m/s]
    braking_window: float = BRAKING_WINDOW
    """How far below the present speed a lower target may draw the command [m/s] in the fine-tuning phase,
    drawn between ``window`` and this at every update. With the paper's 1 m/s no robot is ever asked to stop
    from more than that, and falls when an evaluation asks it to."""
    hold: tuple[float, float] = (0.2, 0.6)  # least and greatest time between updates [s]
    biased_share: float = 0.75  # share of the updates that move toward the target
    ramp_share: float = 0.0
    """Share of the targets to which the command moves at a constant acceleration instead, ahead of the robot
    if it cannot follow, as a user's command does."""
    ramp: tuple[float, float] = (2.0, 4.0)  # least and greatest such acceleration [m/s^2]
    ramps_when_steady: bool = False
    """In the fine-tuning phase all commands move so: a command that waits for the robot opens the range, but
    pays whoever is slow."""
    keeps_rest: bool = False
    """A robot whose target is rest gets no uniform draws. With them it is asked to walk on after a second,
    and trots on the spot in between."""

    def __post_init__(self) -> None:
        for field in ("window", "braking_window"):
            check_positive(field, getattr(self, field), "m/s")
        check_interval("hold", self.hold, 0.0, unit="s")
        check_interval("ramp", self.ramp, 0.0, unit="m/s^2")
        for field in ("biased_share", "ramp_share"):
            check_range(field, getattr(self, field), 0.0, 1.0)

    @property
    def follows_targets(self) -> bool:
        """Whether any command moves toward its target; the paper's, as printed, wander."""
        return self.biased_share > 0.0 or self.ramp_share > 0.0

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        xp = namespace(step.random)
        remaining = state.time_to_update - step.dt
        update = renewed | (remaining <= 0.0)
        held = xp.where(update, self._draw(state.target_speed, step), state.command[:, 0])
        acceleration = xp.where(renewed, self._ramp(step), state.acceleration)
        speed = xp.where(acceleration > 0.0, ramped(state, acceleration, step), held)
        hold = xp.where(update, between(self.hold, step.random[:, 7]), remaining)
        return self._commanded(state, speed, step, time_to_update=hold, acceleration=acceleration)

    def _ramp(self, step: CommandStep) -> Array:
        """Acceleration [m/s^2] ``(n,)`` with which the command goes to a new target; 0: ACS moves it."""
        random, share = step.random, self.ramp_share
        xp, drawn = namespace(random), between(self.ramp, random[:, 6])
        if self.ramps_when_steady:
            share = share + (1.0 - share) * step.steady
        return xp.where(random[:, 5] < share, drawn, xp.zeros_like(drawn))

    def _draw(self, target: Array, step: CommandStep) -> Array:
        """A speed of the neighbourhood [m/s] ``(n,)``."""
        xp, speed, random = namespace(target), step.speed, step.random
        braking_window = self.window + step.steady * (self.braking_window - self.window)
        braking_window = self.window + (braking_window - self.window) * random[:, 5]
        biased = self_paced(target, speed, self.window, braking_window)
        anywhere = speed + self.window * (2.0 * random[:, 5] - 1.0)
        toward = random[:, 6] < self.biased_share
        if self.keeps_rest:
            toward = toward | (target == 0.0)
        return xp.where(toward, biased, anywhere)


@dataclass(frozen=True, kw_only=True)
class UniformSchedule(TargetSchedule):
    """Commands uniform over the range, given at once: no scheduling, no grid, no preference for the top."""

    targets: TargetSampling = TargetSampling(top_share=0.0, grid=None)

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        return self._commanded(state, state.target_speed, step, time_to_update=state.time_to_target)


@dataclass(frozen=True, kw_only=True)
class FixedAccelerationSchedule(TargetSchedule):
    """The command moves to the target at a constant acceleration drawn with each target."""

    acceleration: tuple[float, float] = (2.0, 4.0)
    """Least and greatest acceleration [m/s^2] (the paper's 2 and 4)."""

    def __post_init__(self) -> None:
        check_interval("acceleration", self.acceleration, 0.0, unit="m/s^2")

    def _follow(self, state: CommandState, renewed: Array, step: CommandStep) -> CommandState:
        xp = namespace(step.random)
        acceleration = xp.where(renewed, between(self.acceleration, step.random[:, 7]), state.acceleration)
        speed, zeros = ramped(state, acceleration, step), xp.zeros_like(acceleration)
        return self._commanded(state, speed, step, time_to_update=zeros, acceleration=acceleration)
