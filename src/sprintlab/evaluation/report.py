"""A race as one self-contained HTML file, and its pictures as PNG files beside it."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from matplotlib.figure import Figure

from sprintlab.commands import SpeedProfile
from sprintlab.commands.profiles import BRAKING_WINDOW, PACE_WINDOW
from sprintlab.core.text import number
from sprintlab.core.theme import png_bytes
from sprintlab.evaluation import figures
from sprintlab.evaluation.report_text import (
    LANE_MARK,
    audit_failure,
    audit_limit,
    audit_measured,
    audit_verdict,
    engine_fault,
    engine_table,
    fall_text,
    result_rows,
    setup_rows,
    steady_text,
)
from sprintlab.evaluation.results import RaceResult, SpeedResult, SprintResult, TrialResult
from sprintlab.evaluation.second_engine import ENGINE_STEPS
from sprintlab.robots import RobotDescription

Progress = Callable[[str], None]
PlannedFigure = tuple[str, str, str, Callable[[], Figure]]
"""Name, heading, caption and drawing function of a figure."""

_PROFILE = SpeedProfile(top_speed=1.0)
METHOD = (
    "Plant: MuJoCo C with 0.25 ms steps, feet on pads with dry friction; the policy runs at "
    "50 Hz, the motor loop at 1 kHz, and the refined motor model limits every torque whatever the policy was "
    f"trained with. Profile: stand {_PROFILE.stand:g} s, command rises at {_PROFILE.acceleration:g} m/s² to "
    f"the top speed, hold {_PROFILE.hold:g} s, fall at {_PROFILE.acceleration:g} m/s² to zero, stand "
    f"{_PROFILE.rest:g} s. Held speed: mean forward speed in the heading frame over the last 2 s of the "
    "hold. Peak: best mean over 0.5 s. J: integral of roll rate² plus pitch rate² over the profile. "
    f"Self-paced: the command leads the measured speed by at most {PACE_WINDOW:g} m/s and lags it by at most "
    f"{BRAKING_WINDOW:g} m/s."
)

_DRAKE_STEPS = ENGINE_STEPS["drake"]
DRAKE_REMARK = f"Run in the second engine ({_DRAKE_STEPS}), not in MuJoCo; the rest holds for both."


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One figure of the report."""

    name: str  # file name without ending
    title: str
    caption: str  # what to look at
    png: bytes


def representative(result: SpeedResult) -> TrialResult:
    """The trial to draw: the first that completed and kept its trajectory, else the first that kept it.

    Raises:
        SimulationError: no trial kept a trajectory.
    """
    kept = [trial for trial in result.trials if trial.trajectory is not None]
    chosen = [trial for trial in kept if trial.completed] or kept or list(result.trials)
    figures.recorded(chosen[0])
    return chosen[0]


def draw_pictures(plan: Iterable[PlannedFigure], progress: Progress = lambda _: None) -> tuple[Picture, ...]:
    """Draw planned figures; errors are those of what draws."""
    pictures = []
    for name, title, caption, draw in plan:
        progress(title)
        pictures.append(Picture(name=name, title=title, caption=caption, png=png_bytes(draw())))
    return tuple(pictures)


def render_report(
    result: RaceResult,
    robot: RobotDescription,
    pictures: Sequence[Picture],
    facts: Sequence[tuple[str, str]] = (),
    video: bytes | None = None,
    video_message: str = "",
    replay: str = "",
) -> str:
    """The HTML text: everything inside, nothing loaded from elsewhere.

    ``facts`` are pairs of name and value that say how to repeat it; ``video`` is an MP4, in whose place the
    message stands; ``replay`` is the name of the interactive page beside the report, to which there is no
    link when it is left out.
    """
    fault = engine_fault(result)
    return page_template("report.html.j2").render(
        title=f"{robot.name.upper()}: {result.sprint.distance:g} m with real motor limits",
        subtitle=f"Policy {result.policy}, {result.mass:.1f} kg, top command {result.top_speed:g} m/s",
        verdict=f"exploit audit {audit_verdict(result.audit)}",
        audit_passed=result.audit.passed,
        failures=[*map(audit_failure, result.audit.failed), *([fault] if fault else [])],
        tiles=list(_tiles(result)),
        setup=list(setup_rows(result, robot)),
        results=list(result_rows(result)),
        engines=engine_table(result),
        figures=[embedded(picture) for picture in pictures],
        audit=[
            (item.name, audit_measured(item), audit_limit(item), item.passed, item.note, item.source)
            for item in result.audit.items
        ],
        trials=list(_trial_rows(result)),
        method=METHOD if result.engine == "mujoco" else f"{DRAKE_REMARK} {METHOD}",
        repeat=[*facts, *(("note", note) for note in result.notes)],
        video=None if video is None else _base64(video),
        video_message=video_message,
        replay=replay,
    )


def planned_figures(result: RaceResult, robot: RobotDescription) -> Iterator[PlannedFigure]:
    """Every figure in the order of the report."""
    raw, paced = representative(result.raw), representative(result.self_paced)
    yield (
        "sprint",
        "The 100 metres",
        "Steep is better: how soon the curve is flat tells whether acceleration or top speed costs the time. "
        "The small numbers are the seconds at every ten metres.",
        lambda: figures.sprint_figure(result.sprint, result.sprint_self_paced),
    )
    yield (
        "speed",
        "Speed against command",
        "Shaded: the hold. Look at the gap between the measured speed and the command: where it opens and "
        "stays open, the robot has run out of motor or of grip. Below, the command waits for the robot.",
        lambda: figures.speed_figure(raw, paced),
    )
    yield from trial_figures(raw, robot)


def trial_figures(trial: TrialResult, robot: RobotDescription) -> Iterator[PlannedFigure]:
    """What motors, feet and trunk did in one trial."""
    yield (
        "torque_speed",
        "Torque and speed of every motor over its envelope",
        "Filled: what the motor can really give. Red samples sit on the limit. Look at the upper right "
        "corner: samples between the dashed line and the filled area would be allowed by a model without "
        "d-axis voltage, and do not exist here.",
        lambda: figures.torque_speed_figure(trial, robot),
    )
    yield (
        "gait",
        "Gait",
        "Feet on the ground during the last second of the hold, front legs on top. A fast gait shows short "
        "bars and wide shaded flights; a crawling one shows bars that overlap.",
        lambda: figures.gait_figure(trial, robot),
    )
    yield (
        "base_rates",
        "Roll and pitch of the trunk",
        "Roll and pitch rates of the trunk, and the cost J that sums their squares. A straight rise of J "
        "means a steady gait; a jump marks the moment that nearly went wrong.",
        lambda: figures.rates_figure(trial),
    )
    yield (
        "power",
        "Where the power goes",
        "Mechanical power drives the legs, copper loss only heats the windings. Look at which joints burn "
        "more than they deliver.",
        lambda: figures.power_figure(trial, robot),
    )


def page_template(name: str) -> Template:
    """A template of the folder ``templates``, which may include the others."""
    loader = PackageLoader("sprintlab.evaluation", "templates")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined).get_template(name)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def embedded(picture: Picture) -> dict[str, str]:
    """A picture as the templates take it."""
    return {**vars(picture), "png": _base64(picture.png)}


def _tiles(result: RaceResult) -> Iterator[tuple[str, str, str]]:
    """The numbers at the top of the page: value, unit, label."""
    raw, distance = result.raw, f"{result.sprint.distance:g} m"
    share = np.nanmax(np.append(np.asarray(raw.mean("envelope_share"), dtype=float), -1.0))
    yield _time_tile(result.sprint, f"{distance}, raw command")
    yield _time_tile(result.sprint_self_paced, f"{distance}, self-paced")
    yield number(raw.mean("held_speed")), "m/s", ", ".join(filter(None, ("held speed", steady_text(raw))))
    yield number(raw.mean("peak_speed")), "m/s", "peak, 0.5 s mean"
    yield number(raw.mean("angular_cost"), 1), "rad²/s", "J, roll and pitch"
    yield f"{raw.falls} of {len(raw.trials)}", "", "falls, raw command"
    yield number(100 * share, 0) if share >= 0 else "-", "%", "on the envelope, busiest joint"
    yield number(raw.mean("cost_of_transport")), "", "cost of transport"


def _time_tile(sprint: SprintResult, label: str) -> tuple[str, str, str]:
    if not sprint.finished:
        return "not finished", "", label
    return number(sprint.time), "s", f"{label}, {LANE_MARK}" if sprint.left_lane else label


def _trial_rows(result: RaceResult) -> Iterator[tuple[str, ...]]:
    """Cells under the headings of the table of trials."""
    for command, group in (("raw", result.raw), ("self-paced", result.self_paced)):
        for trial in group.trials:
            drawn, metrics = trial.settings, trial.metrics
            end = "completed" if trial.completed else "did not stop"
            yield (
                command,
                str(drawn.seed),
                number(drawn.friction),
                f"{drawn.payload:+.2f}",
                number(metrics.held_speed),
                number(metrics.peak_speed),
                number(metrics.angular_cost, 1),
                number(metrics.cost_of_transport),
                number(metrics.lateral_deviation),
                fall_text(trial) if trial.fall_reason else end,
            )
