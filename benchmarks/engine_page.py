"""Writes the tables of docs/how-it-works.md from the files below results/engine.

python benchmarks/engine_page.py
"""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE, RESULTS = ROOT / "docs" / "how-it-works.md", ROOT / "results" / "engine"


def running_table() -> str:
    """Worst deviation from the plant and worst effect of halving the step, of each policy and step."""
    found = json.loads((RESULTS / "running.json").read_text(encoding="utf-8"))
    lines = ["| policy | step | held speed | stride | power | foot force | halving: speed, foot force |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for policy, numbers in found.items():
        plant, spread = numbers.pop("plant"), numbers.pop("plant spread")
        shares = [max(spread[v][name] / plant[v][name] for v in plant) for name in next(iter(plant.values()))]
        lines.append(_row(policy, "plant, two trials", shares))
        for step, half in zip(numbers, [*list(numbers)[1:], None], strict=True):
            halved = _worst(numbers[step], numbers[half]) if half else None
            last = "" if halved is None else f"{halved[0]:.1%}, {halved[3]:.1%}"
            lines.append(
                _row(policy, f"{1e3 * float(step.split()[0]):g} ms", _worst(numbers[step], plant), last)
            )
    return "\n".join(lines)


def _row(policy: str, step: str, shares: list[float], last: str = "") -> str:
    cells = [policy, step, *(f"{share:.1%}" for share in shares), last]
    return f"| {' | '.join(cells)} |".replace("%", " %")


def _worst(ours: dict, theirs: dict) -> list[float]:
    """Greatest relative difference of each number over the speeds."""
    names = next(iter(theirs.values()))
    return [max(abs(ours[v][name] / theirs[v][name] - 1.0) for v in theirs) for name in names]


def throughput_table() -> str:
    """Policy steps per second of every file of ``benchmarks/engine.py``."""
    lines = [
        "| device | date | step | robots | policy steps/s | compiling, first and cached |",
        "|---|---|---|---|---|---|",
    ]
    for path in sorted(RESULTS.glob("throughput-*.json")):
        found = json.loads(path.read_text(encoding="utf-8"))
        compiled = " and ".join(f"{seconds:.1f} s" for seconds in found["compile"].values())
        for row in found["throughput"]:
            step = f"{row['substeps']} x {1e3 * row['timestep [s]']:g} ms"
            rate = f"{row['policy steps/s'] / 1e6:.3g} M"
            cells = (found["device"], found["date"][:10], step, str(row["robots"]), rate, compiled)
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def accuracy_table() -> str:
    """What ``benchmarks/engine_accuracy.py`` found."""
    found = json.loads((RESULTS / "accuracy.json").read_text(encoding="utf-8"))
    worst = max(found["acceleration"].values())
    lines = ["| | found | allowed |", "|---|---|---|"]
    lines += [
        f"| acceleration against `mj_forward`, 1000 states per robot, single precision | {worst:.1e} | 1e-5 |"
    ]
    for case, steps in _by_case(found["rebound"]).items():
        shares = ", ".join(f"{step} {share:.1%}".replace("%", " %") for step, share in steps.items())
        lines.append(
            f"| rebound of BP2's leg, {case}, 2 and 4 m/s, against steps of 0.02 ms | {shares} | 10 % |"
        )
    return "\n".join(lines)


def _by_case(rebound: dict[str, dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    cases = next(iter(rebound.values()))
    return {
        case: {step: rebound[step][case]["deviation from fine steps"] for step in rebound} for case in cases
    }


def page(text: str) -> str:
    """The page with its tables as the results have them."""
    tables = {"running": running_table(), "accuracy": accuracy_table(), "throughput": throughput_table()}
    for name, table in tables.items():
        pattern = rf"(<!-- {name} -->).*?(<!-- /{name} -->)"
        text = re.sub(
            pattern, lambda found, table=table: f"{found[1]}\n\n{table}\n\n{found[2]}", text, flags=re.S
        )
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
