"""What a training says at its end are commands that the command line understands."""

import shlex
from pathlib import Path

from sprintlab.cli.main import Command, named_commands, parse
from sprintlab.cli.train import next_steps


def test_the_lines_can_be_copied_where_names_have_spaces():
    first, *lines = next_steps(Path("my runs/one/checkpoint.pt")).splitlines()
    assert first == "policy: my runs/one/policy.onnx"
    words = [shlex.split(line.removeprefix("next:")) for line in lines]
    assert all(each[0] == "sprintlab" for each in words)
    learning, race = (parse(each[1:]) for each in words)
    known = named_commands(Command)
    assert type(learning) is known["learning"] and type(race) is known["race"]
    assert learning.run_folder == Path("my runs/one")
    assert race.policy == "my runs/one/policy.onnx"
