"""Write the tables of README and pages from the committed results: no number of a policy is typed by hand.

    python tools/result_tables.py

A table stands between ``<!-- table: NAME -->`` and ``<!-- end of table -->``. ``results/POLICY/result.json``
is what ``sprintlab race --json`` printed, ``robustness.json`` what ``sprintlab robustness --json`` did; where
``seeds.json`` exists (``tools/judge_seeds.py`` writes it), the tables say median, worst and best seed.
The default policy also has ``fastest.json``, a race at a higher command that passes the audit, too,
``lap.json`` (``sprintlab lap sprint --top-speed 8 --json``),
``lap-battery.json`` (the same with ``--battery --heat``), ``ground.json``
(``sprintlab ground sprint --top-speed 10 --json``) and
``turning.json`` (``sprintlab turning sprint --json``). Battery, Drake and randomized speeds make one figure;
every robot's limit, beside what its policies hold, makes the other.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from measurement_tables import RESULTS, as_table, cell, measurement_tables

from sprintlab.core.text import number
from sprintlab.core.theme import DARK, LIGHT, Theme
from sprintlab.evaluation.report_text import audit_limit, audit_measured
from sprintlab.evaluation.results import AuditItem

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
DEFAULT_POLICY = "sprint"
TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
Row = dict[str, Any]


def tables() -> dict[str, str]:
    """Every table by its name."""
    races, engines = policy_results("result.json"), second_engine_rows()
    sprints = policy_results("robustness.json")
    return {
        "beside_the_paper": beside_the_paper(
            races[DEFAULT_POLICY], policy_results("fastest.json")[DEFAULT_POLICY], engines
        ),
        "policies": policies(races, engines, sprints),
        "audit": audit_lines(races),
        "robustness": robustness(sprints),
        "besides": besides(RESULTS / DEFAULT_POLICY),
        "second_engine": second_engine(engines),
        "limits": limits(beside_limits(races, policy_results("seeds.json"))),
        **measurement_tables(),
    }


def with_tables(text: str, found: dict[str, str]) -> str:
    """A page with the present numbers in its tables."""
    return TABLE.sub(lambda match: f"{match[1]}\n{found[match[2]]}\n\n{match[3]}", text)


def policy_results(file: str) -> dict[str, Any]:
    """What a command printed for each policy, ``results/POLICY/FILE``, the default policy first."""
    paths = sorted(RESULTS.glob(f"*/{file}"), key=lambda path: path.parent.name != DEFAULT_POLICY)
    return {path.parent.name: json.loads(path.read_text(encoding="utf-8")) for path in paths}


def second_engine_rows() -> list[Row]:
    """What each policy does in MuJoCo and in Drake."""
    found = json.loads((RESULTS / "second_engine/speeds.json").read_text(encoding="utf-8"))
    return list(found["policies"].values())


def beside_the_paper(race: Row, fastest: Row, engines: Sequence[Row]) -> str:
    """The README's table: the paper and others as reported, and the shipped policy in both engines."""
    reported = [
        ("the paper, BP2", "simulation, reported", "12.4 m/s", ""),
        ("the paper, BP2", "treadmill; outdoors, reported", "13.2 m/s; 11.65 m/s", "11.67 s"),
    ]
    drake = next(row["drake"] for row in engines if row["policy"] == DEFAULT_POLICY)
    ours = [
        (
            who,
            f"{engine}, {row['falls']} of {row['trials']} trials fell",
            speed,
            f"{cell(row['sprint_time_s'])} s",
        )
        for who, engine, row, speed in (
            (_asked(DEFAULT_POLICY, race), "MuJoCo", race, held(race) + seeds(DEFAULT_POLICY)),
            ("the same", "Drake", drake, _speed(drake["held_speed_m_s"])),
            (_asked(DEFAULT_POLICY, fastest), "MuJoCo", fastest, held(fastest)),
        )
    ]
    others = [
        ("Margolis et al. 2022, Mini Cheetah", "robot, reported", "3.9 m/s", ""),
        ("Shin et al. 2023, KAIST Hound", "robot, reported", "6.5 m/s", ""),
        ("Miller et al. 2025, Spot", "robot, reported", "5.2 m/s", ""),
    ]
    return as_table(("who", "where", "speed", "100 m"), [*reported, *ours, *others])


def _asked(policy: str, race: Row) -> str:
    return f"`{policy}`, asked for {race['top_speed_command_m_s']:g} m/s, audit {audit(race)}"


def seeds(policy: str) -> str:
    """What all its seeds hold, and that it is their median one; empty without ``seeds.json``."""
    path = RESULTS / policy / "seeds.json"
    if not path.is_file():
        return ""
    speeds = [row["held_speed_m_s"] for row in json.loads(path.read_text(encoding="utf-8"))]
    which = "median" if len(speeds) > 2 else "better"
    return f", {which} of {len(speeds)} seeds ({number(min(speeds))} to {number(max(speeds))})"


def policies(races: dict[str, Row], engines: Sequence[Row], sprints: dict[str, Row]) -> str:
    """One row per policy of the package."""
    drake = {row["policy"]: row["drake"]["held_speed_m_s"] for row in engines}
    head = ("policy", "robot", "command", "held, MuJoCo", "held, Drake", "100 m", "upright", "audit")
    rows = [
        (
            f"`{name}`",
            f"`{race['robot']}`",
            f"{race['top_speed_command_m_s']:g} m/s",
            held(race) + seeds(name),
            _speed(drake.get(name)),
            time(race),
            upright(sprints[name]),
            audit(race),
        )
        for name, race in races.items()
    ]
    return as_table(head, rows)


def audit_lines(races: dict[str, Row]) -> str:
    """Every line of the audit, one column per policy; what fails is bold."""
    columns = list(races.values())
    measures: list[tuple[str, Callable[[Row], str]]] = [
        ("held, raw command", held),
        ("held, self-paced command", lambda row: held(row["self_paced"])),
        ("stride frequency", lambda row: f"{cell(row['stride_frequency_Hz'], 1)} Hz"),
        ("duty factor", lambda row: cell(row["duty"], 3)),
        ("cost of transport", lambda row: cell(row["cost_of_transport"])),
    ]
    rows = [(label, *(text(row) for row in columns)) for label, text in measures]
    for items in zip(*(row["audit"]["items"] for row in columns), strict=True):
        rows.append((f"{items[0]['name']}: {audit_limit(AuditItem(**items[0]))}", *map(_audit_cell, items)))
    return as_table(("", *(f"`{name}`" for name in races)), rows)


def robustness(sprints: dict[str, Row]) -> str:
    """Shares upright and quantiles of the held speed, everything randomized at once."""
    head = ("policy", "command", "upright (95 % interval)", "5 / 50 / 95 % of these hold less than")
    rows = []
    for name, row in sprints.items():
        found = row["held_speed_quantiles_m_s"]
        speeds = " / ".join(cell(found[quantile], 1) for quantile in ("0.05", "0.5", "0.95"))
        rows.append((f"`{name}`", f"{row['top_speed_command_m_s']:g} m/s", upright(row), f"{speeds} m/s"))
    return as_table(head, rows)


def second_engine(engines: Sequence[Row]) -> str:
    """Speeds, falls and times in both engines."""
    head = ("policy", "MuJoCo", "Drake", "change", "falls, MuJoCo / Drake", "100 m, MuJoCo / Drake")
    rows = []
    for row in engines:
        first, second, change = row["mujoco"], row["drake"], row["speed_change"]
        cells = (
            f"`{row['policy']}`",
            _speed(first["held_speed_m_s"]),
            _speed(second["held_speed_m_s"]),
            "-" if change is None else f"{100 * change:+.1f} %",
            f"{first['falls']} / {second['falls']} of {first['trials']}",
            f"{cell(first['sprint_time_s'])} / {cell(second['sprint_time_s'])} s",
        )
        rows.append(cells)
    return as_table(head, rows)


def besides(folder: Path) -> str:
    """What the default policy does besides running straight: laps, turns, slopes and rough ground."""
    lap, warm, ground, turning = (
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("lap", "lap-battery", "ground", "turning")
    )
    gain = turning["least_gain_up_to_half_of_friction"]
    rows = [
        (f"400 m, asked for {lap['top_speed_command_m_s']:g} m/s", _lap(lap)),
        ("the same on a battery with windings that warm up", _lap(warm)),
        (
            "yaw rate, turns of up to half of what friction allows",
            f"at least {100 * gain:.0f} % of the command",
        ),
        ("turns of up to all of it, 0 to 12 m/s", f"{turning['falls']} of {len(turning['turns'])} fall"),
    ]
    names = {"uphill": "5 % uphill", "downhill": "5 % downhill", "rough": "rough ground of 2 cm"}
    for trials in ground["grounds"][1:]:
        change = f"{round(100 * trials['change']) + 0:+d} % of the speed held on level ground"
        what = f"{names[trials['ground']]}, asked for {ground['top_speed_command_m_s']:g} m/s"
        rows.append((what, f"{change}, {trials['upright']} of {trials['trials']} upright"))
    return as_table(("", "measured"), rows)


def _lap(lap: Row) -> str:
    if not lap["finished"]:
        return f"falls ({lap['fall_reason']})"
    heat = lap["hottest_winding_degC"]
    parts = [f"{number(lap['time_s'])} s", "in its lane" if lap["lane_kept"] else "left its lane"]
    return ", ".join([*parts, *([f"hottest winding {heat:.0f} degC"] if heat else [])])


def beside_limits(races: dict[str, Row], trained: dict[str, list[Row]]) -> dict[str, Row]:
    """Every robot's limit; what its policy or else its median seed holds [m/s]; the fastest that passes.

    A robot without a policy in the package has its seeds in ``results/ROBOT/seeds.json``.
    """
    robots = json.loads((RESULTS / "speed_limit/robots.json").read_text(encoding="utf-8"))["robots"]
    faster = policy_results("fastest.json")
    for name in {**races, **trained}:
        seeds, runs = trained.get(name, []), [each[name] for each in (races, faster) if name in each]
        passed = [run["held_speed_m_s"] for run in runs if audit(run) == "passed"]
        passed += [seed["best_passed_m_s"] for seed in seeds if seed["best_passed_m_s"]]
        shown = races.get(name) or seeds[len(seeds) // 2]
        robots[shown.get("robot", name)] |= {
            "held": shown["held_speed_m_s"],
            "passed": audit(shown) == "passed" if name in races else not shown["failed"],
            "fastest": max(passed, default=None),
        }
    return robots


def limits(robots: dict[str, Row]) -> str:
    """Each robot's speed limit, and what is held beside it."""
    head = ("robot", "outdoors", "no air", "strides", "held", "audit", "fastest, audit passed")
    rows = [
        (
            f"`{name}`",
            _speed(row["limit_m_s"]),
            _speed(row["treadmill_m_s"]),
            row["strides"],
            _beside(row.get("held"), row["limit_m_s"]),
            {True: "passed", False: "**failed**", None: "-"}[row.get("passed")],
            _beside(row.get("fastest"), row["limit_m_s"]),
        )
        for name, row in robots.items()
    ]
    return as_table(head, rows)


def _beside(speed: float | None, limit: float) -> str:
    return "-" if speed is None else f"{_speed(speed)}, {100 * speed / limit:.0f} %"


def limits_figure(robots: dict[str, Row]) -> bytes:
    """PNG: a bar for each robot's limit, marks for what is held beside it."""
    figure = Figure(figsize=(8.0, 0.42 * len(robots) + 1.3), layout="constrained")
    axes, places, rows = figure.subplots(), range(len(robots)), list(robots.values())
    speeds = [row["limit_m_s"] for row in rows]
    axes.barh(places, speeds, height=0.55, color=LIGHT.envelope, label="limit of motors and legs, outdoors")
    for place, speed in zip(places, speeds, strict=True):
        axes.text(0.15, place, number(speed), va="center", color=LIGHT.muted)
    held = [((row["held"], place), row["passed"]) for place, row in enumerate(rows) if row.get("held")]
    fastest = [(row["fastest"], place) for place, row in enumerate(rows) if row.get("fastest")]
    for label, marker, colour, points in (
        ("held, audit passed", "o", LIGHT.speed, [point for point, passed in held if passed]),
        ("held, audit failed", "X", LIGHT.on_limit, [point for point, passed in held if not passed]),
        ("fastest of all seeds, audit passed", "D", LIGHT.second, fastest),
    ):
        if points:
            axes.scatter(*zip(*points, strict=True), s=60, marker=marker, color=colour, zorder=3, label=label)
    axes.set_yticks(list(places), list(robots))
    axes.invert_yaxis()
    axes.set_xlabel("speed [m/s]")
    axes.tick_params(left=False)
    axes.spines[:].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return _png(figure)


def realism(race: Row, engines: Sequence[Row], sprint: Row) -> list[tuple[str, float]]:
    """The default policy's speed [m/s] from the least to the most realistic judgement of it."""
    limits = json.loads((RESULTS / "speed_limit/robots.json").read_text(encoding="utf-8"))["robots"]
    second = next(row for row in engines if row["policy"] == DEFAULT_POLICY)
    spread = sprint["held_speed_quantiles_m_s"]
    return [
        ("limit of motors and legs", limits[race["robot"]]["limit_m_s"]),
        ("held in MuJoCo", race["held_speed_m_s"]),
        ("held in Drake", second["drake"]["held_speed_m_s"]),
        ("on a battery, windings warm", race["battery"]["held_speed_m_s"]),
        ("all randomized, upright: every second run", spread["0.5"]),
        ("all randomized, upright: 19 of 20 runs", spread["0.05"]),
    ]


def speeds_figure(points: Sequence[tuple[str, float]], theme: Theme) -> bytes:
    """PNG: speed against realism, which grows downward."""
    figure = Figure(figsize=(8.0, 0.45 * len(points) + 0.9), layout="constrained", facecolor=theme.background)
    axes = figure.subplots()
    axes.set_facecolor(theme.background)
    speeds, places = [speed for _, speed in points], range(len(points))
    axes.hlines(places, 0.0, speeds, color=theme.envelope, lw=9.0)
    axes.scatter(speeds, places, s=70, color=[theme.envelope, *[theme.speed] * (len(points) - 1)], zorder=3)
    for place, speed in zip(places, speeds, strict=True):
        axes.text(speed + 0.25, place, number(speed), va="center", color=theme.foreground)
    axes.set_yticks(list(places), [name for name, _ in points])
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.1 * max(speeds))
    axes.set_xlabel("speed [m/s]", color=theme.foreground)
    axes.tick_params(colors=theme.foreground, left=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return _png(figure)


def _png(figure: Figure) -> bytes:
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=110, metadata={"Software": None})
    return image.getvalue()


def audit(race: Row) -> str:
    """Whether the audit passed, or the names of the lines that failed."""
    failed = [item["name"] for item in race["audit"]["items"] if not item["passed"]]
    return f"**failed: {', '.join(failed)}**" if failed else "passed"


def time(race: Row) -> str:
    """Time over 100 m, with its mark."""
    if race["time_100m_s"] is None:
        return "not finished"
    return f"{number(race['time_100m_s'])} s" + (", left its lane" if race["left_lane"] else "")


def held(trials: Row) -> str:
    """What was held, and how many trials fell or did not stop."""
    faults = {"fell": trials["falls"], "did not stop": trials["not_stopped"]}
    marks = [f"{count} of {trials['trials']} {fault}" for fault, count in faults.items() if count]
    return ", ".join([_speed(trials["held_speed_m_s"]), *marks])


def upright(row: Row) -> str:
    """Sprints without a fall, with their interval."""
    lower, upper = (100 * bound for bound in row["interval_95"])
    return f"{row['upright']} of {row['trials']} ({lower:.0f} to {upper:.0f} %)"


def _audit_cell(item: Row) -> str:
    numbers = {key: float("nan") if item[key] is None else item[key] for key in ("value", "worst")}
    text = audit_measured(AuditItem(**item | numbers))
    return text if item["passed"] else f"**{text}**"


def _speed(value: float | None) -> str:
    return "-" if value is None else f"{number(value)} m/s"


if __name__ == "__main__":
    found = tables()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        page.write_text(with_tables(text, found), encoding="utf-8")
    race, sprint = (policy_results(file)[DEFAULT_POLICY] for file in ("result.json", "robustness.json"))
    points = realism(race, second_engine_rows(), sprint)
    for name, theme in (("speeds", LIGHT), ("speeds-dark", DARK)):
        (ROOT / "docs" / "images" / f"{name}.png").write_bytes(speeds_figure(points, theme))
    picture = limits_figure(beside_limits(policy_results("result.json"), policy_results("seeds.json")))
    (ROOT / "docs" / "figures" / "limits.png").write_bytes(picture)
