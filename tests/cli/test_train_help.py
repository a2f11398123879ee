"""`train --help` is a page; `--help-all` has every setting."""

import pytest

from sprintlab.cli.main import main

pytest.importorskip("torch", reason="needs the extra train")


def shown(option, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["train", option])
    assert stop.value.code == 0
    return capsys.readouterr().out


def test_help_is_a_page_and_names_where_the_rest_is(capsys):
    text = shown("--help", capsys)
    assert len(text.splitlines()) < 80
    assert "--method" in text and "--output" in text and "--help-all" in text
    assert "--ppo" not in text and "settings." not in text
    assert "--robot" in text and "--config" in text


def test_help_all_has_every_setting(capsys):
    text = shown("--help-all", capsys)
    assert "--ppo.steps" in text and "settings." not in text and len(text.splitlines()) > 80


def test_help_needs_no_pytorch(monkeypatch, capsys):
    monkeypatch.setattr("sprintlab.cli.train.require_training", lambda: pytest.fail("asked for the extra"))
    assert "--method" in shown("--help", capsys)
