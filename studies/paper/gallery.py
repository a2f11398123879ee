"""Every figure of the paper from committed policies and results: simulated, drawn, written."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sprintlab.control import Policy, load_policy
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import read_lines, table_number
from sprintlab.core.theme import png_bytes
from sprintlab.evaluation.results import SprintResult, TrialResult
from sprintlab.evaluation.trial import TrialRequest, run_course, run_sprint, run_trial
from sprintlab.motors import MotorModel
from sprintlab.plant import PlantOptions
from sprintlab.robots import RobotDescription
from studies.paper import figures
from studies.paper.command_modes import COMMAND_MODES, CommandSequence
from studies.paper.measure import Candidate
from studies.paper.runs import Run, by_method, committed_records
from studies.paper.training_cloud import TrainingCloud, load_training_cloud

DPI = 80
CURVE_NAME = "curve.csv"
CURVE_LIMIT = 16 << 20
"""Largest learning curve that is read [bytes]."""
CHEAT = "no-envelope"
"""Method shown beside the main one where there is a cloud of its training: its motors know no limits."""
_CURVE_COLUMNS = ("seconds", "speed_p999")
_LARGEST = 1e12  # of any number: a figure has no room for more

Progress = Callable[[str, float | None], None]


@dataclass(frozen=True, kw_only=True)
class Gallery:
    """What the figures are made from.

    Attributes:
        robot: what runs.
        policies: the policies of the methods.
        runs: finished runs with curves and evaluations; may be none.
        main: the policy of the figures that show one policy.
        top_speed: v* of every run [m/s].
        distance: of the sprint [m].
    """

    robot: RobotDescription
    policies: tuple[Candidate, ...]
    runs: tuple[Run, ...]
    main: Candidate
    top_speed: float = 12.0
    distance: float = 100.0


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A figure of the gallery.

    Attributes:
        name: of its file, without ending.
        title: what it shows, in a few words.
        caption: how to read it.
        draw: makes it.
    """

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]


def write_gallery(gallery: Gallery, folder: Path, progress: Progress = lambda *_: None) -> list[Drawing]:
    """Draw every figure that the material allows, each written to ``<folder>/<name>.png`` in one step.

    Args:
        gallery: the material.
        folder: where the PNG files go.
        progress: called with what is being made and the share done.

    Returns:
        What was drawn, in order.

    Raises:
        SprintlabError: a policy is refused, a curve is damaged, the simulation failed or the disk refuses.
    """
    drawings = list(_drawings(gallery))
    for index, drawing in enumerate(drawings):
        progress(f"figure {drawing.name}", index / len(drawings))
        atomic_write_bytes(folder / f"{drawing.name}.png", png_bytes(drawing.draw(), dpi=DPI))
    return drawings


def gallery_text(drawings: Sequence[Drawing], folder: str) -> str:
    """Pictures and captions in Markdown; ``folder`` as seen from the page."""
    parts = (f"![{item.title}]({folder}/{item.name}.png)\n\n{item.caption}" for item in drawings)
    return "\n\n".join(parts)


_TEXTS = {
    "envelopes": (
        "Operating envelopes of the motor models",
        "The operating envelope of each motor under the three models, on the robot's bus. Shaded: what a "
        "model without d-axis voltage allows and the motor cannot give. Look at 25 to 40 rad/s of hip and "
        "knee, where a sprint needs its torque.",
    ),
    "worlds": (
        "One policy in two worlds",
        "Policy `{policy}` in two worlds: left with {world}, right with the real motor; all else is the "
        "evaluation's. Red: what no real motor of this kind could do. Compare the held speeds, and how much "
        "of the left clouds is red.",
    ),
    "command-modes": (
        "One policy under every way of changing the command",
        "Policy `{policy}`; the same speed targets, given in different ways: at once (`uniform`), at a "
        "fixed 3 m/s², within 1 m/s of the present speed (`adaptive`, the paper's ACS), and one step to "
        "the top speed. Look at where the speed leaves the command, and at falls.",
    ),
    "sprint": (
        "Speed and motor use over the sprint",
        "Policy `{policy}` over {distance} m: speed, and what hind hips and knees do on the way, over "
        "the envelope that the plant enforces. Look at how many points lie on the limit: that joint's "
        "motor, not the policy, sets the speed. The cloud of the training is not shown: none was kept with "
        "the run of this policy.",
    ),
    "clouds": (
        "Speed and motor use, in training and in the evaluation",
        "{policies}: for each, left the last two seconds of its training, robots of its own world with their "
        "exploration noise, randomization and commands, and right {distance} m in the evaluation. Above the "
        "speeds, below what hind hips and knees do, over the nominal envelope. Red: what the real motor, on "
        "the bus and with the resistance of that robot, could not do. Look at how many points lie on the "
        "limit, and whether a policy uses in training what the evaluation does not give it.",
    ),
    "estimate": (
        "Estimate against truth over the sprint",
        "What policy `{policy}` believes of its own body over {distance} m, filtered as it uses it, and "
        "what the simulator knows. Look at the gap in forward velocity at top speed; the estimate's low-pass "
        "smooths the contact of single strides.",
    ),
    "methods": (
        "Speed by method",
        "The most that is held with the raw command: every seed, their mean, and the paper's robot. Compare "
        "orders and ratios; where the seeds of two methods overlap, the order of their means says little.",
    ),
    "learning": (
        "Learning curves",
        "Speed of the fastest robots in training over time: mean and range over the seeds, each with the "
        "motor of its own training: high curves of methods without limits are no speeds of the real robot.",
    ),
}
"""Title and caption of every figure."""


def _drawings(gallery: Gallery) -> Iterator[Drawing]:
    """Every figure that the material allows, in the order of the page."""
    policy, robot = load_policy(gallery.main.policy), gallery.robot
    yield _drawing("envelopes", gallery, lambda: figures.envelope_figure(robot))
    for candidate in _with_worlds(gallery):
        yield _worlds_drawing(gallery, candidate)
    yield _drawing("command-modes", gallery, lambda: figures.commands_figure(command_runs(policy, gallery)))
    yield _sprint_drawing(gallery, policy)
    if policy.estimates:
        yield _drawing("estimate", gallery, lambda: figures.estimate_figure(_sprint(policy, gallery).trial))
    records = by_method(committed_records(gallery.runs))
    if any(records.values()):
        yield _drawing("methods", gallery, lambda: figures.methods_figure(records))
    curves = learning_curves(gallery.runs)
    if curves:
        yield _drawing("learning", gallery, lambda: figures.learning_figure(curves))


def _drawing(name: str, gallery: Gallery, draw: Callable[[], Figure]) -> Drawing:
    title, caption = _TEXTS[name]
    caption = caption.format(policy=gallery.main.method, distance=f"{gallery.distance:g}")
    return Drawing(name=name, title=title, caption=caption, draw=draw)


def _sprint_drawing(gallery: Gallery, policy: Policy) -> Drawing:
    """The sprint of the main policy, beside its training where a cloud of it was kept."""
    clouds = training_clouds(gallery)
    if not clouds:
        return _drawing(
            "sprint", gallery, lambda: figures.sprint_figure(_sprint(policy, gallery), gallery.robot)
        )
    title, caption = _TEXTS["clouds"]
    names = " and ".join(f"`{candidate.method}`" for candidate, _ in clouds)
    return Drawing(
        name="sprint",
        title=title,
        caption=caption.format(policies=names, distance=f"{gallery.distance:g}"),
        draw=lambda: _clouds(gallery, clouds),
    )


def training_clouds(gallery: Gallery) -> list[tuple[Candidate, TrainingCloud]]:
    """The main policy with the cloud of its training, and the cheat's beside it, where their runs kept one.

    Raises:
        SprintlabError: a cloud is damaged, or of another robot.
    """
    shown = [gallery.main]
    shown += [one for one in gallery.policies if one.method == CHEAT and one.method != gallery.main.method]
    found = [(candidate, _cloud_path(gallery, candidate)) for candidate in shown]
    if found[0][1] is None:
        return []
    return [(candidate, _cloud(path, gallery.robot)) for candidate, path in found if path is not None]


def _cloud_path(gallery: Gallery, candidate: Candidate) -> Path | None:
    """The cloud of the run that the policy came from."""
    for run in gallery.runs:
        if (run.method, run.seed) == (candidate.method, candidate.seed) and run.cloud.is_file():
            return run.cloud
    return None


def _cloud(path: Path, robot: RobotDescription) -> TrainingCloud:
    cloud = load_training_cloud(path)
    if cloud.robot != robot.name:
        raise SprintlabError(f"{path} is of robot {cloud.robot}, and the figures are of {robot.name}")
    return cloud


def _clouds(gallery: Gallery, clouds: Sequence[tuple[Candidate, TrainingCloud]]) -> Figure:
    """Every policy once over the distance, beside its training."""
    worlds = [
        figures.BothWorlds(
            method=candidate.method,
            training=cloud,
            sprint=_sprint(load_policy(candidate.policy), gallery),
        )
        for candidate, cloud in clouds
    ]
    return figures.clouds_figure(worlds, gallery.robot)


def _worlds_drawing(gallery: Gallery, candidate: Candidate) -> Drawing:
    title, caption = _TEXTS["worlds"]
    return Drawing(
        name=f"worlds-{candidate.method}",
        title=title,
        caption=caption.format(policy=candidate.method, world=_WORLD_NAMES[_other_world(candidate)]),
        draw=lambda: _worlds(gallery, candidate),
    )


def _with_worlds(gallery: Gallery) -> list[Candidate]:
    """Policies to show in two worlds: those trained with another motor, else the main one."""
    cheats = [one for one in gallery.policies if _training_model(one) != "refined"]
    return cheats or [gallery.main]


def _training_model(candidate: Candidate) -> str:
    return load_policy(candidate.policy).contract.training.actuator_model


_WORLD_NAMES: dict[MotorModel, str] = {
    "square": "a motor that gives its peak torque at every speed",
    "simplified-dc": "a motor without d-axis voltage",
}


def _other_world(candidate: Candidate) -> MotorModel:
    """The motor that it was trained with; an ideal one if that was the real one."""
    return "simplified-dc" if _training_model(candidate) == "simplified-dc" else "square"


def _worlds(gallery: Gallery, candidate: Candidate) -> Figure:
    """The policy with the motor it was trained with (an ideal one if that was refined), and the real one."""
    trained, other = _training_model(candidate), _other_world(candidate)
    policy = load_policy(candidate.policy)
    first = f"{candidate.method}: {figures.MODEL_NAMES[other]}" + (", as trained" if other == trained else "")
    second = f"{candidate.method}: refined" + (", as trained" if trained == "refined" else "")
    worlds = (
        (first, world_run(policy, gallery, other)),
        (second, world_run(policy, gallery, "refined")),
    )
    return figures.worlds_figure(worlds, gallery.robot)


def world_run(policy: Policy, gallery: Gallery, model: MotorModel) -> TrialResult:
    """The profile once, with one motor model."""
    request = TrialRequest(
        top_speed=gallery.top_speed, plant=PlantOptions(motor_model=model), keep_trajectory=True
    )
    return run_trial(policy, gallery.robot, request)


def command_runs(policy: Policy, gallery: Gallery) -> list[tuple[CommandSequence, TrialResult]]:
    """One run in every command update mode."""
    request = TrialRequest(top_speed=gallery.top_speed, keep_trajectory=True)
    courses = [CommandSequence(mode=mode, top_speed=gallery.top_speed) for mode in COMMAND_MODES]
    return [(course, run_course(policy, gallery.robot, request, course)) for course in courses]


def _sprint(policy: Policy, gallery: Gallery) -> SprintResult:
    request = TrialRequest(top_speed=gallery.top_speed, distance=gallery.distance, keep_trajectory=True)
    return run_sprint(policy, gallery.robot, request)


def learning_curves(runs: tuple[Run, ...]) -> dict[str, list[dict[str, np.ndarray]]]:
    """Method to the learning curves of its seeds, those that there are.

    Raises:
        SprintlabError: a curve is damaged.
    """
    curves: dict[str, list[dict[str, np.ndarray]]] = {}
    for run in runs:
        path = run.folder / CURVE_NAME
        if path.is_file():
            curves.setdefault(run.method, []).append(read_curve(path))
    return curves


def read_curve(path: Path) -> dict[str, np.ndarray]:
    """Training time and speed of a learning curve.

    Raises:
        SprintlabError: the file cannot be read, or a column is missing, stands twice, or holds no numbers or
            too large ones.
    """
    rows = csv.reader(read_lines(path, CURVE_LIMIT, "learning curve"))
    try:
        header = next(rows, [])
        if len(set(header)) < len(header):
            raise ValueError("a column stands twice in it")
        places = {name: header.index(name) for name in _CURVE_COLUMNS}
        values = np.array(
            [
                [table_number(row[place], name, rows.line_num) for name, place in places.items()]
                for row in filter(None, rows)
            ]
        )
    except (LookupError, ValueError, csv.Error) as error:
        raise SprintlabError(f"{path} is no learning curve: {error}") from error
    if not len(values):
        raise SprintlabError(f"{path} is no learning curve: it has no rows")
    if (np.abs(values) > _LARGEST).any():
        raise SprintlabError(f"{path} is no learning curve: a number is beyond {_LARGEST:g}")
    return dict(zip(_CURVE_COLUMNS, values.T, strict=True))
