"""Build wheel and sdist, install the wheel into an empty environment, and use it: ``make package-test``.

Prints how long the install took and how much room it takes; ends at the first step that fails.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SMOKE = (
    ("--help",),
    ("robot", "list"),
    ("motor", "show", "bp2", "hip", "--json"),
    ("race", "--top-speed", "3", "--trials", "1", "--no-video", "--output", "race"),
    ("replay", "race", "--json"),
    ("limit", "--quick", "--starts", "1", "--json"),
    ("motor", "identify", "BENCH", "--pole-pairs", "21", "--json"),
    ("audit", "rollout.csv", "--motor", "go1", "--json"),
    ("doctor", "--json"),
)
BENCH = ROOT / "examples" / "motors" / "bench.csv"
ROLLOUT = "time,joint_velocity_FL_calf,joint_torque_FL_calf\n0,1,5\n0.02,12,60\n"


def call(*command: str | Path, folder: Path = ROOT) -> str:
    """Run a command without this project's sources on the path; returns what it printed."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    run = subprocess.run(
        [str(part) for part in command], cwd=folder, env=environment, stdout=subprocess.PIPE, text=True
    )
    if run.returncode != 0:
        sys.exit(f"failed with status {run.returncode}: {' '.join(map(str, command))}")
    return run.stdout


def build(folder: Path) -> tuple[Path, Path]:
    """Wheel and sdist."""
    call(sys.executable, "-m", "hatchling", "build", "-d", folder)
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


def install(programs: Path, what: Path | str) -> None:
    """Install with every version as published in constraints.txt."""
    call(
        programs / "python",
        "-m",
        "pip",
        "install",
        "--quiet",
        "--only-binary=:all:",
        "-c",
        ROOT / "constraints.txt",
        what,
    )


def environment_size(folder: Path) -> int:
    """Bytes of everything installed, pip's own files left out."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files if "pip" not in path.relative_to(folder).parts[:1])


def main() -> None:
    """Build, install, use."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON only")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="package-test-") as name:
        folder = Path(name)
        wheel, sdist = build(folder / "dist")
        venv.create(folder / "env", with_pip=True)
        programs = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        started = time.perf_counter()
        install(programs, wheel)
        found = {
            "wheel_bytes": wheel.stat().st_size,
            "sdist_bytes": sdist.stat().st_size,
            "install_seconds": round(time.perf_counter() - started, 1),
        }
        (packages,) = (folder / "env").rglob("site-packages")
        found["installed_megabytes"] = round(environment_size(packages) / 1e6)
        found["of_them_sprintlab"] = round(environment_size(packages / "sprintlab") / 1e6, 1)
        (folder / "rollout.csv").write_text(ROLLOUT)
        for arguments in SMOKE:
            started = time.perf_counter()
            words = [BENCH if word == "BENCH" else word for word in arguments]
            call(programs / "sprintlab", *words, folder=folder)
            found["sprintlab " + " ".join(arguments)] = round(time.perf_counter() - started, 2)
        # The sdist must hold everything that a wheel is made of.
        call(programs / "python", "-m", "pip", "install", "--quiet", "--no-deps", "--force-reinstall", sdist)
        call(programs / "sprintlab", "robot", "show", "bp2", folder=folder)
    if given.json:
        print(json.dumps(found, indent=2))
    else:
        print("\n".join(f"{name:60} {value}" for name, value in found.items()))


if __name__ == "__main__":
    main()
