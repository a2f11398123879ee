"""The section on what a motor law is worth in mjlab is written from the committed results."""

import json
import shutil
from pathlib import Path

from studies.mjlab_speed.page import mean_speed, page, promise, trials_of

ROOT = Path(__file__).parents[2]


def test_the_committed_section_is_that_of_the_committed_results(tmp_path):
    (tmp_path / "figures").mkdir()
    shutil.copy(ROOT / "docs/integrations.md", tmp_path)
    page(ROOT / "results/mjlab-speed", tmp_path)
    assert (tmp_path / "integrations.md").read_text() == (ROOT / "docs/integrations.md").read_text()


def test_speeds_are_those_of_the_trials_without_a_fall_under_one_law_at_one_command():
    def trial(law, command, speed, fell=False):
        return {"law": law, "command": command, "speed": speed, "fell": fell, "beyond": 0.0}

    own = [trial("stock", 2.0, 2.1), trial("stock", 2.0, 0.3, fell=True), trial("stock", 3.0, 2.9)]
    refined = [trial("refined", 2.0, 1.8)]
    runs = json.loads(json.dumps([{"actuator": "stock", "trials": own + refined}]))
    assert mean_speed(trials_of(runs, "stock", "stock", 2.0)) == 2.1
    assert promise(runs, "stock", 2.0) == "`stock` promises 0.30 m/s more"
