"""What a training says at its end are commands that the command line understands."""

import shlex
from pathlib import Path

from sprintlab.cli.export import Export
from sprintlab.cli.learning import Learning
from sprintlab.cli.main import parse
from sprintlab.cli.race import Race
from sprintlab.cli.train import next_steps


def test_the_lines_can_be_copied_where_names_have_spaces():
    text = next_steps(Path("my runs/one/checkpoint.pt")).removeprefix("next: ")
    lines = [shlex.split(line) for line in text.splitlines()]
    assert all(words[0] == "sprintlab" for words in lines)
    learning, export, race = (parse(words[1:]) for words in lines)
    assert isinstance(learning, Learning) and isinstance(export, Export) and isinstance(race, Race)
    assert learning.run_folder == Path("my runs/one")
    assert race.policy == "my runs/one/policy.onnx"
