"""Tables of measurements that need no new policy: engine, motor law elsewhere, robot's bus, designs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from sprintlab.core.text import number
from sprintlab.integrations.mjcf import dc_motor_excess
from sprintlab.motors import library_motors, load_library_motor

RESULTS = Path(__file__).resolve().parents[1] / "results"
GUESTS = {
    "Isaac Lab": "isaaclab",
    "mjlab": "mjlab",
    "Newton": "newton",
    "Playground": "playground",
    "plain MuJoCo, one robot": "mujoco",
}
MJLAB_ACTUATORS = {
    "position": "BuiltinPositionActuatorCfg",
    "dc_motor": "DcMotorActuatorCfg",
    "refined": "PmsmActuatorCfg",
}
NEWTON_STAGES = {
    "peak_torque": "ClampingMaxEffort",
    "straight_line": "ClampingDCMotor",
    "refined": "PmsmClamping",
}
TRAINED = "design/bp2-trained"
"""What ``sprintlab design --json`` found with trained policies; it takes GPU hours and may be missing."""
WORK = "driving work that the motors could not do"
Row = dict[str, Any]


def measurement_tables() -> dict[str, str]:
    """Every table of this file by its name."""
    trained = (
        {"trained_designs": trained_designs(_read(TRAINED))} if (RESULTS / f"{TRAINED}.json").exists() else {}
    )
    return trained | {
        "engine_running": engine_running(_read("engine/running")),
        "engine_accuracy": engine_accuracy(_read("engine/accuracy")),
        "engine_throughput": engine_throughput(),
        "training_time": training_time(),
        "motor_law": motor_law(_read("throughput/motor_law")),
        "mjcf_export": mjcf_export(),
        "mjlab_walk": mjlab_walk(_read("integrations/mjlab-go1")),
        "newton_walk": newton_walk(_read("integrations/newton-anymal")),
        "guest_costs": guest_costs(_read("integrations/cost")),
        "bus_tolerance": bus_tolerance(_read("deployment/bus_tolerance")["rows"]),
        "design": design(_read("design/bp2")),
    }


def as_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def engine_running(found: Row) -> str:
    """Worst deviation from the plant and worst effect of halving the step, for each policy and step."""
    rows = []
    for policy, numbers in found.items():
        plant, spread = numbers.pop("plant"), numbers.pop("plant spread")
        names = next(iter(plant.values()))
        own = [max(spread[speed][name] / plant[speed][name] for speed in plant) for name in names]
        rows.append((policy, "plant, two trials", *map(_percent, own), ""))
        for step, half in zip(numbers, [*list(numbers)[1:], None], strict=True):
            halved = _worst(numbers[step], numbers[half]) if half else None
            last = f"{_percent(halved[0])}, {_percent(halved[3])}" if halved else ""
            title = f"{1e3 * float(step.split()[0]):g} ms"
            rows.append((policy, title, *map(_percent, _worst(numbers[step], plant)), last))
    head = ("policy", "step", "held speed", "stride", "power", "foot force", "halving: speed, foot force")
    return as_table(head, rows)


def _worst(ours: Row, theirs: Row) -> list[float]:
    """Greatest relative difference of each number over the speeds."""
    names = next(iter(theirs.values()))
    return [max(abs(ours[speed][name] / theirs[speed][name] - 1.0) for speed in theirs) for name in names]


def engine_accuracy(found: Row) -> str:
    """What ``benchmarks/engine_accuracy.py`` found."""
    worst, rebound = max(found["acceleration"].values()), found["rebound"]
    what = "acceleration against `mj_forward`, 1000 states per robot, single precision"
    rows = [(what, f"{worst:.1e}", "1e-5")]
    for case in next(iter(rebound.values())):
        shares = {step: cases[case]["deviation from fine steps"] for step, cases in rebound.items()}
        what = f"rebound of BP2's leg, {case}, 2 and 4 m/s, against steps of 0.02 ms"
        rows.append((what, ", ".join(f"{step} {_percent(share)}" for step, share in shares.items()), "10 %"))
    return as_table(("", "found", "allowed"), rows)


def engine_throughput() -> str:
    """Policy steps per second in every file of ``benchmarks/engine.py``."""
    rows = []
    for path in sorted((RESULTS / "engine").glob("throughput-*.json")):
        found = json.loads(path.read_text(encoding="utf-8"))
        compiled = " and ".join(f"{seconds:.1f} s" for seconds in found["compile"].values())
        for row in found["throughput"]:
            step = f"{row['substeps']} x {1e3 * row['timestep [s]']:g} ms"
            rate = f"{row['policy steps/s'] / 1e6:.3g} M"
            rows.append((found["device"], found["date"][:10], step, str(row["robots"]), rate, compiled))
    head = ("device", "date", "step", "robots", "policy steps/s", "compiling, first and cached")
    return as_table(head, rows)


def training_time() -> str:
    """Where an iteration's time goes, for every file of ``benchmarks/training.py``."""
    parts = ("physics", "environment", "acting", "update")
    rows = []
    for path in sorted((RESULTS / "engine").glob("training-*.json")):
        found = json.loads(path.read_text(encoding="utf-8"))
        times, steps = found["times_s"], found["steps"]
        spent = [times[part] * (1 if part == "update" else steps) for part in parts]
        cells = (f"{1e3 * seconds:.1f}" for seconds in (*spent, times["iteration"]))
        start, rate = sum(found["start_s"].values()), found["training_steps_per_s"] / 1e6
        circumstances = (found["device"], found["date"][:10], str(found["robots"]))
        rows.append((*circumstances, f"{rate:.2f} M", *cells, f"{start:.0f} s"))
    head = ("device", "date", "robots", "policy steps/s", *parts, "iteration [ms]", "start")
    return as_table(head, rows)


def motor_law(found: Row) -> str:
    """Time of the motor law in NumPy."""
    rows = [(model, f"{1e3 * seconds:.0f} ms") for model, seconds in found["seconds"].items()]
    return as_table(("model", f"{found['points']:,} points"), rows)


def mjcf_export() -> str:
    """Torque that MuJoCo's ``<dcmotor>`` gives beyond each library motor's envelope."""
    head = ("actuator", "driving, at most", "driving, mean over speeds", "braking, at most", "at standstill")
    rows = []
    for name in library_motors():
        motor = load_library_motor(name)
        excess = dc_motor_excess(motor.motor, motor.gear, motor.bus_voltage)
        shares = (excess[part] for part in ("driving", "driving_mean", "braking", "stalled"))
        rows.append((f"`{name}`", *(f"{abs(round(100.0 * share))} %" for share in shares)))
    return as_table(head, rows)


def mjlab_walk(found: Row) -> str:
    """mjlab's Go1 on three of its actuators."""
    keys = ("held_m_s", "fastest_calf_rad_s", "impossible_work_share")
    rows = [_walk(name, *(found[f"{law}_1.5"][key] for key in keys)) for law, name in MJLAB_ACTUATORS.items()]
    return as_table(("actuator", "held at 1.5 m/s", "fastest calf", WORK), rows)


def newton_walk(found: Row) -> str:
    """ANYmal with Newton's clamping stages."""
    keys = ("held_{}_m_s", "fastest_joint_{}_rad_s", "impossible_work_share_{}")
    rows = [_walk(name, *(found[key.format(law)] for key in keys)) for law, name in NEWTON_STAGES.items()]
    return as_table(("clamping stage", "held at 1 m/s", "fastest joint", WORK), rows)


def _walk(name: str, held_speed: float, fastest: float, share: float) -> Sequence[str]:
    return f"`{name}`", f"{held_speed:.2f} m/s", f"{fastest:.1f} rad/s", _percent(share)


def guest_costs(found: Row) -> str:
    """Time per step of each framework's own actuators and of ours [us]."""
    rows = []
    for title, guest in GUESTS.items():
        times = list(found[guest]["microseconds_per_step"].values())
        line = times[1] if len(times) > 2 else None
        rows.append((title, *(cell(each, 0) for each in (times[0], line, times[-1]))))
    return as_table(("framework", "limits only", "straight line", "this package"), rows)


def bus_tolerance(found: Sequence[Row]) -> str:
    """What delay, jitter and loss on the robot's bus cost."""
    link = ("round trip [ms]", "jitter [ms]", "loss [%]")
    head = (*link, "falls", "not at the line", "100 m [s]", "before the line [m/s]")
    rows = [
        (
            *(f"{row[key]:g}" for key in ("delay_ms", "jitter_ms", "loss_percent")),
            f"{row['falls']} of {row['runs']}",
            str(row["unfinished"]),
            *(cell(row[key], 2) for key in ("time_100m_s", "held_speed_m_s")),
        )
        for row in found
    ]
    return as_table(head, rows)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def cell(value: float | None, digits: int = 2) -> str:
    """A number in a table; a dash where it is missing."""
    return "-" if value is None else number(value, digits)


def _read(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def design(found: Row) -> str:
    """What each motor model chooses of ``sprintlab design``, then the best design of each winding."""
    named = _chosen_and_best(found["designs"], "limits", "speed_m_s")
    head = (
        "design",
        "winding",
        "hip gear",
        "knee gear",
        "limit",
        "by v_d = 0",
        "current",
        "power",
        "after 10 s",
    )
    rows = [
        (
            what,
            *(f"{row['design'][name]:g}" for name in ("winding", "gear.hip", "gear.knee")),
            *(f"{row['limits'][model]['speed_m_s']:.2f} m/s" for model in ("refined", "simplified-dc")),
            f"{row['current_A']:.0f} A",
            f"{row['limits']['refined']['power_W']:.0f} W",
            f"{row['limits']['refined']['winding_degC']:.0f} degC",
        )
        for what, row in named
    ]
    return as_table(head, rows)


def trained_designs(found: Row) -> str:
    """The same by the policies that were trained under each motor model, all judged with the refined one."""
    head = (
        "design",
        "winding",
        "hip gear",
        "trained",
        "trained with v_d = 0",
        "and believed",
        "power",
        "hottest winding",
    )
    rows = []
    for what, row in _chosen_and_best(
        [row for row in found["designs"] if "trained" in row], "trained", "believed_m_s"
    ):
        refined, other = (row["trained"][model] for model in ("refined", "simplified-dc"))
        speeds = (refined["speed_m_s"], other["speed_m_s"], other["believed_m_s"])
        rows.append(
            (
                what,
                *(f"{row['design'][name]:g}" for name in ("winding", "gear.hip")),
                *(f"{speed:.2f} m/s" for speed in speeds),
                f"{refined['power_W']:.0f} W",
                f"{refined['winding_degC']:.0f} degC",
            )
        )
    return as_table(head, rows)


def _chosen_and_best(designs: Sequence[Row], key: str, name: str) -> list[tuple[str, Row]]:
    """The designs that the motor models choose, and that the refined one finds best for each winding."""
    ranked = sorted(designs, key=lambda row: row[key]["refined"][name])
    best = {row["design"]["winding"]: row for row in ranked}
    wrong = max(ranked, key=lambda row: row[key]["simplified-dc"][name])
    chosen = [("chosen by the refined motor", ranked[-1]), ("chosen by v_d = 0", wrong)]
    return chosen + [(f"best with winding {winding:g}", row) for winding, row in sorted(best.items())]
