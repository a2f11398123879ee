"""Every policy of the package in MuJoCo and in Drake, and what each holds.

    python benchmarks/second_engine.py sprint --workers 2 --store

One 100 m and ten seeded trials of the raw profile in each engine at the headline speed, with the same draws.
A policy takes about 6 minutes of one core, most of it Drake's. ``--store`` keeps a policy's numbers in
results/second_engine as soon as it is finished.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from harness import EVALUATION_PACKAGES, answer, circumstances

from sprintlab.api.policies import policy_path
from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.core.files import atomic_write_json
from sprintlab.evaluation.pool import TrialPool
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.results import EngineResult, SpeedResult, SprintResult, TrialResult
from sprintlab.evaluation.second_engine import engine_requests, mark, speed_change
from sprintlab.plant import ENGINES, check_engine
from sprintlab.robots import load_robot

OTHER_TOP_SPEED = 10.0
RESULT = Path("results/second_engine/speeds.json")


def headline_speed(policy: str) -> float:
    """Command [m/s] at which a policy's race is published."""
    path = Path("results") / policy / "result.json"
    if not path.is_file():
        return OTHER_TOP_SPEED
    return float(json.loads(path.read_text(encoding="utf-8"))["top_speed_command_m_s"])


def run_in(pool: TrialPool, speed: float, settings: ProtocolSettings, engine: str) -> EngineResult:
    """The 100 m and the seeded trials."""
    results = list(pool.stream(engine_requests(speed, 100.0, settings, engine)))
    sprints = [result for result in results if isinstance(result, SprintResult)]
    trials = [result for result in results if isinstance(result, TrialResult)]
    raw = SpeedResult(top_speed=speed, self_paced=False, trials=tuple(trials), required=settings.required)
    return EngineResult(engine=engine, sprint=sprints[0], raw=raw)


def measure(path: Path, settings: ProtocolSettings, chosen: argparse.Namespace) -> dict[str, Any]:
    """One policy in both engines."""
    robot, name = load_robot(load_policy(path).contract.robot_name), path.stem
    speed = chosen.top_speed or headline_speed(name)
    with TrialPool(path, robot, workers=chosen.workers) as pool:
        runs = {engine: run_in(pool, speed, settings, engine) for engine in ENGINES}
    first, second = (runs[engine] for engine in ENGINES)
    return {
        "policy": name,
        "robot": robot.name,
        "top_speed_command_m_s": speed,
        "hold_s": settings.hold,
        **{engine: rounded(result.to_dict()) for engine, result in runs.items()},
        "speed_change": rounded(speed_change(first.raw, second.raw)),
        "mark": mark(first.raw, second.raw),
    }


def rounded(value: Any) -> Any:
    """Numbers to four places; ``None`` where one is NaN."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, float):
        return round(value, 4) if value == value else None
    return value


def parse() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "policies",
        nargs="*",
        default=sorted(shipped_policies()),
        help="names or files; all of the package when left out",
    )
    parser.add_argument(
        "--top-speed", type=float, help="command [m/s]; the policy's headline speed when left out"
    )
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--trials", type=int, default=10, help="seeded trials per engine")
    parser.add_argument("--hold", type=float, default=10.0, help="[s]")
    parser.add_argument("--output", type=Path, help="also write JSON there")
    parser.add_argument("--store", action="store_true", help="keep the numbers in results/second_engine")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def compare(chosen: argparse.Namespace) -> dict[str, Any]:
    """Every policy asked for, by the SHA-256 of its file."""
    settings = ProtocolSettings(trials=chosen.trials, required=chosen.trials, hold=chosen.hold)
    check_engine("drake")
    rows = {}
    for name in chosen.policies:
        path = policy_path(name)
        rows[digest(path)] = measure(path, settings, chosen)
        if chosen.store:
            store(rows)
    return document(rows)


def digest(path: Path) -> str:
    """SHA-256 of a file: by what a result names its policy."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def document(rows: dict[str, Any]) -> dict[str, Any]:
    """Rows, and what they were measured with."""
    return {"policies": rows, **circumstances((*EVALUATION_PACKAGES, "drake"))}


def store(rows: dict[str, Any]) -> None:
    """Keep the rows of the package's policies, the new ones in place of those of the same file."""
    shipped = {digest(shipped_policy(name)) for name in shipped_policies()}
    known = {**json.loads(RESULT.read_text(encoding="utf-8"))["policies"], **rows}
    atomic_write_json(RESULT, document({key: row for key, row in known.items() if key in shipped}))


def show(result: dict[str, Any]) -> None:
    """One line per policy."""
    for row in result["policies"].values():
        held = [f"{engine} {row[engine]['held_speed_m_s']} m/s" for engine in ENGINES]
        print(row["policy"], "at", row["top_speed_command_m_s"], *held, row["mark"] or "no mark", sep="  ")


if __name__ == "__main__":
    sys.exit(answer(parse, compare, show))
