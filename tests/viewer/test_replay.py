import json
import re

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import sprintlab as sl
from sprintlab.cli.main import main
from sprintlab.commands import command_start
from sprintlab.core.errors import SprintlabError
from sprintlab.robots import ModelOptions, build_model, load_robot, robot_names
from sprintlab.viewer.envelope_plot import EnvelopePlot
from sprintlab.viewer.replay import (
    WORLD_RECORDS,
    ReplayRun,
    render_replay,
    torque_share,
)

MISCHIEF = '</script><b>"x" & y'
GO_TO = "moment => { replay.setPlaying(false); replay.goTo(moment); }"


def start_of(arrays):
    return command_start(arrays["time"], arrays["command"])


@pytest.fixture(scope="module")
def page(recorded, robot):
    return render_replay([ReplayRun(arrays=recorded, robot=robot)], f"A run {MISCHIEF}", "test")


@pytest.fixture(scope="module")
def page_file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "replay.html"
    path.write_text(page, encoding="utf-8")
    return path


def test_page_loads_nothing_from_elsewhere(page):
    assert re.findall(r"(?:https?:)?//[\w.-]+\.\w+/", page) == []
    assert re.findall(r"<(?:link|img|iframe)|<script[^>]+src|@import|\bfetch\(", page) == []
    assert len(page) < 1_000_000 and MISCHIEF not in page


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_can_be_replayed_and_shown(name):
    robot = load_robot(name)
    model = build_model(robot, ModelOptions(visuals=True))
    count, joints = 10, len(robot.joint_names)
    still = {key: np.zeros((count, joints)) for key in ("joint_velocity", "motor_torque")}
    limits = {"torque_lower": np.full((count, joints), -1.0), "torque_upper": np.full((count, joints), 1.0)}
    flat = {"velocity": np.zeros((count, 2)), "command": np.zeros((count, 3))}
    arrays = {"time": np.arange(count) / 500.0, "qpos": np.tile(model.key("stand").qpos, (count, 1))}
    run = ReplayRun(arrays={**arrays, **still, **limits, **flat}, robot=robot)
    page = render_replay([run], name)
    assert robot.joint_names[0].replace("_", " ") in page
    drawing = EnvelopePlot(robot).draw(np.zeros((2, joints)), np.zeros((2, joints)), "refined", 20.0)
    assert drawing.count("<circle") == joints


@given(
    torque=st.floats(-20, 20),
    lower=st.floats(-15, 15),
    width=st.floats(0, 30),
)
def test_torque_share_is_a_share_and_full_at_a_limit(torque, lower, width):
    upper = lower + width
    clipped = np.clip(torque, lower, upper)
    share = float(torque_share(np.array(clipped), np.array(lower), np.array(upper)))
    assert 0.0 <= share <= 1.0
    if clipped == upper and clipped > 1e-9:
        assert share == pytest.approx(1.0)


def test_browser_computes_the_poses_that_mujoco_computes(tab, page_file, recorded, robot):
    tab.goto(page_file.as_uri())
    tab.wait_for_function("window.replay !== undefined")
    model = build_model(robot, ModelOptions(visuals=True))
    data = mujoco.MjData(model)
    middle = len(recorded["time"]) // 8 * 4  # a sample that is a frame of the page
    data.qpos[:] = recorded["qpos"][middle]
    mujoco.mj_kinematics(model, data)
    tab.evaluate(GO_TO, float(recorded["time"][middle] - start_of(recorded)))
    for leg in robot.leg_names:
        shown = tab.evaluate("name => replay.bodyPosition(name)", f"{leg}_shank")
        assert_allclose(shown, data.body(f"{leg}_shank").xpos, atol=2e-4)


def test_page_plays_scrubs_and_slows_down(tab, page_file):
    tab.goto(page_file.as_uri())
    tab.wait_for_function("window.replay !== undefined && replay.state.now > 0.2")
    assert tab.locator("#failure").is_hidden()
    tab.click("#play")
    tab.locator("#scrub").fill("0.5")
    half = tab.evaluate("replay.start + replay.duration / 2")
    assert tab.evaluate("replay.state.now") == pytest.approx(half, abs=0.02)
    tab.select_option("#rate", "0.1")
    assert tab.evaluate("replay.state.rate") == 0.1
    tab.wait_for_function("Number(document.getElementById('speed').textContent) > 1.0")


# --- clock and ghosts -----------------------------------------------------------------------------------


def shown(tab, name):
    return float(tab.locator(f"#{name}").text_content())


def test_the_clock_starts_with_the_command_and_stops_at_the_finish(tab, recorded, robot, tmp_path):
    distance = 1.0
    way = recorded["qpos"][:, 0] - recorded["qpos"][0, 0]
    reached = float(np.interp(distance, way, recorded["time"])) - start_of(recorded)
    path = tmp_path / "short.html"
    run = ReplayRun(arrays=recorded, robot=robot)
    path.write_text(render_replay([run], "x", distance=distance))
    tab.goto(path.as_uri())
    tab.wait_for_function("window.replay !== undefined")
    for moment, clock in ((-0.5, 0.0), (0.5, 0.5), (reached + 1.0, reached)):
        tab.evaluate(GO_TO, moment)
        tab.wait_for_function(
            f"Math.abs(Number(document.getElementById('clock').textContent) - {clock}) < 0.011"
        )
    assert shown(tab, "way") == pytest.approx(distance, abs=0.06)


@pytest.fixture(scope="module")
def ghosts(recorded, robot, tmp_path_factory):
    """The same run against itself, a tenth of a second later, and against the record."""
    late = {**recorded, "command": recorded["command"].copy()}
    late["command"][recorded["time"] < start_of(recorded) + 0.1] = 0.0
    ghost = ReplayRun(arrays=late, robot=robot, name="late")
    first = ReplayRun(arrays=recorded, robot=robot, name="first")
    path = tmp_path_factory.mktemp("ghosts") / "ghosts.html"
    path.write_text(render_replay([first, ghost], "two", "", 1.0, WORLD_RECORDS[100.0]))
    return path


def test_ghosts_run_on_neighbouring_lanes_with_live_gaps(tab, ghosts, recorded):
    tab.goto(ghosts.as_uri())
    tab.wait_for_function("window.replay !== undefined")
    assert tab.locator("#failure").is_hidden()
    tab.evaluate(GO_TO, 0.5)
    places = [np.array(tab.evaluate("who => replay.bodyPosition('trunk', who)", who)) for who in (0, 1)]
    moments = start_of(recorded) + np.array([0.5, 0.6])
    expected = [np.interp(moments, recorded["time"], recorded["qpos"][:, axis]) for axis in (0, 1)]
    assert_allclose([place[0] for place in places], expected[0], atol=2e-3)
    assert_allclose([places[0][1], places[1][1] + 1.22], expected[1], atol=2e-3)
    first, second, record = tab.evaluate("replay.gaps()")
    assert not record.startswith("\u2212"), "at half a second the record leads"
    behind = [float(text.removeprefix("\u2212").split(" m")[0]) for text in (first, second)]
    assert behind[0] - behind[1] == pytest.approx(float(expected[0][1] - expected[0][0]), abs=0.11)
    tab.evaluate(GO_TO, 1e9)
    assert tab.evaluate("replay.gaps()")[0].endswith(" s")


# --- command ------------------------------------------------------------------------------------------------


def test_command_writes_the_page_beside_the_trajectory(trajectory_file, capsys):
    numbers = {"robot": "bp2", "policy": "sprint", "time_100m_s": 11.5, "audit": {"passed": False}}
    (trajectory_file.parent / "result.json").write_text(json.dumps(numbers))
    assert main(["replay", str(trajectory_file.parent), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    page = (trajectory_file.parent / "replay.html").read_text(encoding="utf-8")
    assert answer["bytes"] == len(page.encode())
    assert "BP2: 100 m in 11.50 s" in page
    assert "exploit audit FAILED" in page
    mine = sl.replay([trajectory_file], output=trajectory_file.with_name("mine.html"))
    assert mine.page.read_text(encoding="utf-8").startswith(page[:100]) and str(mine.page) in str(mine)


@pytest.mark.parametrize(
    ("name", "columns", "message"),
    [("motor_torque", 6, "6 joints, robot bp2 has 12"), ("qpos", 9, "coordinates")],
)
def test_a_trajectory_of_another_robot_is_refused(recorded, robot, name, columns, message):
    other = {**recorded, name: recorded[name][:, :columns]}
    with pytest.raises(SprintlabError, match=message):
        render_replay([ReplayRun(arrays=other, robot=robot)], "x")
