"""Tables from a ladder of commands, and the file that carries them."""

import math

import msgspec
import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.calibration import CalibrationContract
from sprintlab.core.errors import InvalidValueError, PolicyFileError, SprintlabError
from sprintlab.evaluation import calibration
from sprintlab.evaluation.calibration import (
    CalibrationResult,
    LadderSettings,
    Rung,
    calibrated,
    climb,
    tables_of,
    write_calibrated,
)
from sprintlab.evaluation.pool import TrialPool

TABLES = CalibrationContract(
    commanded=(1.0, 1.9), given=(1.0, 2.0), estimated=(1.0, 1.9), true=(1.0, 2.0)
)  # fmt: skip


def ladder(*speeds):
    """Rungs of commands 1, 2, 3 ... m/s from held speeds; estimated and true speeds may follow."""
    rungs = []
    for command, speed in enumerate(speeds, 1):
        held, estimated, true = speed if isinstance(speed, tuple) else (speed, speed, speed)
        rungs.append(Rung(command=float(command), held=held, estimated=estimated, true=true))
    return rungs


def test_the_ladder_climbs_by_1_m_s_to_the_top():
    assert LadderSettings(top_speed=3.25).commands == (1.0, 2.0, 3.0, 3.25)
    assert LadderSettings(top_speed=3.0).commands == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("field", "value"), [("top_speed", 1.0), ("top_speed", 99.0), ("top_speed", math.nan), ("counted", 20.0)]
)
def test_impossible_ladders_are_refused(field, value):
    with pytest.raises(InvalidValueError, match=f"calibrate.{field}"):
        LadderSettings(**{"top_speed": 3.0, field: value})


def test_tables_begin_where_the_error_does_and_are_read_the_other_way_round():
    found = tables_of(ladder(1.02, 1.95, (2.8, 2.6, 2.81), (3.7, 3.3, 3.71)))
    assert (found.commanded, found.given) == ((2.0, 2.8, 3.7), (2.0, 3.0, 4.0))
    assert (found.estimated, found.true) == ((1.95, 2.6, 3.3), (1.95, 2.81, 3.71))


def test_a_ladder_without_error_ends_at_its_top():
    found = tables_of(ladder(1.02, 1.95, 3.05))
    assert (found.commanded, found.given) == ((2.0, 3.05), (2.0, 3.0))


def test_an_error_from_the_first_command_on_begins_at_rest():
    found = tables_of(ladder((0.8, 0.7, 0.8), (1.6, 1.4, 1.6)))
    assert (found.commanded, found.given) == ((0.0, 0.8, 1.6), (0.0, 1.0, 2.0))
    assert (found.estimated, found.true) == ((1.0, 1.4), (1.0, 1.6))  # no estimate below 1 m/s is touched


def test_commands_that_hold_no_more_are_left_out():
    found = tables_of(ladder(1.0, 2.0, 2.7, 2.6, 4.2, 4.3))
    assert (found.commanded, found.given) == ((2.0, 2.7, 4.2), (2.0, 3.0, 5.0))


def test_a_policy_that_never_gets_faster_is_refused():
    with pytest.raises(SprintlabError, match=r"runs much faster than 1\.0 m/s"):
        tables_of(ladder(1.0, 1.0, 0.9))
    with pytest.raises(SprintlabError, match=r"estimates much faster than 2\.0 m/s"):
        tables_of(ladder(1.0, 2.0, (3.0, 1.9, 3.0)))


def test_the_largest_errors_are_those_of_what_can_be_held():
    found = CalibrationResult(
        contract=with_tables(TABLES),
        before=tuple(ladder(1.0, (1.5, 1.5, 1.9))),
        after=tuple(ladder(0.9, 1.95)),
    )
    assert found.worst(found.after) == pytest.approx((0.1, 0.0))  # 2 m/s is more than 1.9
    numbers = found.to_dict()
    assert numbers["fastest_command_held_m_s"] == 1.9
    assert numbers["largest_estimate_error_m_s"]["before"] == pytest.approx(0.4)
    assert numbers["after"][1]["given_m_s"] == 2.0
    assert numbers["calibration"]["given"] == [1.0, 2.0]


def with_tables(tables):
    """The shipped policy's contract, with these tables."""
    return msgspec.structs.replace(load_policy(shipped_policy()).contract, calibration=tables)


@pytest.mark.usefixtures("brief_trials")
def test_a_ladder_of_a_real_policy_runs_with_and_without_tables(robot):
    settings, policy = LadderSettings(top_speed=2.0, hold=1.0, counted=0.4), load_policy(shipped_policy())
    low = CalibrationContract(
        commanded=(0.0, 2.0), given=(0.0, 1.0), estimated=(1.0, 2.0), true=(1.0, 3.0)
    )  # fmt: skip
    plain, told_half = (climb(policy, robot, 2.0, settings, with_tables(tables)) for tables in (None, low))
    assert plain.held == pytest.approx(2.0, abs=0.4) and told_half.held < plain.held - 0.4
    assert plain.estimated == pytest.approx(plain.true, abs=0.4)
    assert policy.contract == load_policy(shipped_policy()).contract


def test_a_fall_ends_the_ladder_and_says_where(robot, monkeypatch):
    def fall_at_three(policy, robot, command, settings, contract):
        fell = command >= 3.0 and (contract.calibration is None) == without
        return Rung(
            command=command, held=command, estimated=command, true=command, fall="tilt" if fell else ""
        )

    monkeypatch.setattr(calibration, "climb", fall_at_three)
    with TrialPool(shipped_policy(), robot, workers=1) as pool:
        without = True
        with pytest.raises(SprintlabError, match=r"^the policy falls \(tilt\) at 3 m/s .*--top-speed"):
            calibrated(pool, LadderSettings(top_speed=4.0))
        without = False
        with pytest.raises(SprintlabError, match=r"^with its tables the policy falls"):
            calibrated(pool, LadderSettings(top_speed=4.0))


def test_a_policy_without_estimator_is_refused(policy, robot):
    with TrialPool(policy, robot, workers=1) as pool, pytest.raises(SprintlabError, match="no estimator"):
        calibrated(pool, LadderSettings(top_speed=4.0))


def test_the_file_carries_the_tables_and_the_same_network(tmp_path):
    source, output = shipped_policy(), tmp_path / "calibrated.onnx"
    policy = load_policy(source)
    write_calibrated(policy, source, with_tables(TABLES), output)
    written = load_policy(output)
    assert written.contract.calibration == TABLES
    assert written.contract.training == policy.contract.training
    again = tmp_path / "again.onnx"
    write_calibrated(written, output, with_tables(TABLES), again)
    assert again.read_bytes() == output.read_bytes()


def test_what_took_the_files_name_while_the_robot_ran_is_kept(tmp_path):
    source, output = shipped_policy(), tmp_path / "calibrated.onnx"
    output.write_text("somebody's")
    placed = write_calibrated(load_policy(source), source, with_tables(TABLES), output)
    assert output.read_text() == "somebody's"
    assert placed == tmp_path / "calibrated-2.onnx" and load_policy(placed).contract.calibration == TABLES


def test_a_full_folder_for_temporary_files_is_told_of_as_any_full_disk(tmp_path):
    resource = pytest.importorskip("resource")
    policy, source = load_policy(shipped_policy()), shipped_policy()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(SprintlabError, match="cannot write"):
            write_calibrated(policy, source, with_tables(TABLES), tmp_path / "new.onnx")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_a_file_that_has_changed_meanwhile_is_refused(tmp_path):
    source = tmp_path / "policy.onnx"
    source.write_bytes(shipped_policy().read_bytes())
    policy = load_policy(source)
    source.write_bytes(shipped_policy("go1-sprint").read_bytes())
    with pytest.raises(PolicyFileError, match="has changed"):
        write_calibrated(policy, source, with_tables(TABLES), tmp_path / "new.onnx")
    assert not (tmp_path / "new.onnx").exists()
