"""Find the highest speed at which each policy of the package passes its audit, and store it beside them.

    python tools/cleared_speeds.py

Run it whenever a policy file changes: an entry is found by the file's checksum, and a policy without one is
tried anew by every ``sprintlab run`` that names no top speed.
"""

from __future__ import annotations

import argparse

from sprintlab.api.clearance import STORED_SPEEDS, TRIED_SPEEDS, cleared_speed
from sprintlab.control import load_policy
from sprintlab.control.policy import shipped_policies
from sprintlab.core.files import atomic_write_json
from sprintlab.robots import load_robot


def main() -> None:
    """Write ``cleared_speeds.json``."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    speeds = {}
    for name, path in shipped_policies().items():
        policy = load_policy(path)
        robot = load_robot(policy.contract.robot_name)
        found = [cleared_speed(policy, robot, self_paced=paced) for paced in (True, False)]
        print(name, found, "m/s self-paced and raw, of", TRIED_SPEEDS)
        speeds[policy.digest] = min(found)
    atomic_write_json(STORED_SPEEDS, speeds)


if __name__ == "__main__":
    main()
