"""Figures, report and video of a race."""

import base64
import errno
import io
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sprintlab.api.races import battery_text
from sprintlab.core.errors import InvalidValueError, SimulationError, SprintlabError
from sprintlab.core.files import default_folder
from sprintlab.evaluation import figures, report, video
from sprintlab.evaluation.audit import CLOCK_ITEM, audit_trials
from sprintlab.evaluation.protocol import ProtocolSettings, battery_request
from sprintlab.evaluation.race_files import save_trajectory
from sprintlab.evaluation.report_text import (
    audit_failure,
    audit_limit,
    audit_value,
    audit_verdict,
    fall_text,
    result_rows,
    setup_rows,
    summary,
)
from sprintlab.evaluation.results import (
    AuditItem,
    AuditReport,
    RaceResult,
    SpeedResult,
    SprintResult,
    require_finite,
)
from sprintlab.motors import WindingHeat
from sprintlab.plant import NOMINAL_TRIAL, PlantOptions


@pytest.fixture
def trial(make_trial, make_trajectory, robot):
    """Ten seconds at 10 m/s: feet on the ground one at a time, front left hip on its envelope."""
    count = 5000
    time = np.arange(count) / 500.0
    qpos = np.zeros((count, 23))
    qpos[:, 0], qpos[:, 2], qpos[:, 3] = 10.0 * time, 0.5, 1.0
    contact = (np.arange(count)[:, None] // 25 + np.arange(4)) % 4 == 0
    torque = np.zeros((count, 12))
    torque[:, 1] = 1.0
    rates = np.stack([np.full(count, 2.0), np.full(count, 1.0), np.zeros(count)], axis=1)
    trajectory = make_trajectory(
        seconds=10.0,
        qpos=qpos,
        velocity=np.tile([10.0, 0.0], (count, 1)),
        foot_contact=contact,
        motor_torque=torque,
        joint_torque=6.0 * torque,
        joint_velocity=np.full((count, 12), 2.0),
        angular_velocity=rates,
    )
    return replace(make_trial(), trajectory=trajectory)


@pytest.fixture
def race(trial, make_trial):
    trials = SpeedResult(
        top_speed=10.0, self_paced=False, trials=(trial, make_trial(completed=False)), required=1
    )
    return RaceResult(
        robot="bp2",
        policy="test <policy>",
        top_speed=10.0,
        sprint=SprintResult(distance=90.0, time=9.0, trial=trial),
        sprint_self_paced=SprintResult(distance=90.0, time=float("nan"), trial=trial),
        raw=trials,
        self_paced=replace(trials, self_paced=True),
        audit=audit_trials([trial.metrics]),
        mass=36.5,
        wall_time=1.0,
    )


@pytest.fixture
def page(race, robot):
    tiny = report.Picture(name="speed", title="Speed", caption="Look.", light=b"light", dark=b"dark")
    return report.render_report(
        race, robot, [tiny], facts=[("command", "sprintlab race")], video_message="no GL"
    )


def test_every_picture_is_a_png_in_both_looks(race, robot):
    drawn = []
    pictures = report.make_pictures(race, robot, drawn.append)
    assert len(pictures) == len(drawn) == 6
    for picture in pictures:
        light, dark = (Image.open(io.BytesIO(data)) for data in (picture.light, picture.dark))
        assert light.size == dark.size and light.width > 900
        corner = np.asarray(light.convert("RGB"))[0, 0], np.asarray(dark.convert("RGB"))[0, 0]
        assert corner[0].min() > 200 and corner[1].max() < 60


def test_report_is_one_file_that_loads_nothing(page):
    assert not re.findall(r"""(?:src|srcset|href)=["'](?!data:|#)""", page)
    assert "http" not in page
    assert base64.b64encode(b"light").decode() in page and base64.b64encode(b"dark").decode() in page
    assert "prefers-color-scheme: dark" in page and "@media print" in page


def test_report_says_what_happened(page):
    assert "test &lt;policy&gt;" in page  # escaped
    assert "not finished" in page and "9.00" in page
    assert "1 of 2" in page and "fell at 3.0 s (tilt)" in page
    assert "no GL" in page and "<video" not in page
    assert "exploit audit passed" in page


def test_a_failed_audit_is_marked(race, robot, trial):
    sunk = replace(trial.metrics, pad_deflection=0.05)
    page = report.render_report(replace(race, audit=audit_trials([sunk])), robot, [])
    assert "exploit audit FAILED 1 of 15 checks" in page and ">FAIL<" in page
    first_screen = page[: page.index('<div class="tiles">')]
    assert "<li>pad deflection 50 mm: at most 15</li>" in first_screen


def test_the_video_is_embedded(race, robot):
    page = report.render_report(race, robot, [], video=b"film")
    assert f"data:video/mp4;base64,{base64.b64encode(b'film').decode()}" in page


def test_gait_diagram_shows_the_contacts(trial, robot):
    axis = figures.gait_figure(trial, robot).axes[0]
    labels = [label.get_text() for label in axis.get_yticklabels()]
    assert [label.split()[0] for label in labels] == list(robot.leg_names)
    assert all(22 <= float(label.split()[1]) <= 28 for label in labels)
    assert "0 % of the time in flight" in axis.get_title(loc="left")


def test_rates_figure_integrates_the_cost(trial):
    curve = figures.rates_figure(trial).axes[2].lines[0].get_ydata()
    assert curve[-1] == pytest.approx((2.0**2 + 1.0**2) * 9.998)


def test_samples_on_the_envelope(trial, robot):
    touched = figures.on_envelope(trial.trajectory, robot)
    assert touched[:, 1].all() and not np.delete(touched, 1, axis=1).any()
    still = replace(trial.trajectory, command=np.zeros((5000, 3)))
    assert not figures.on_envelope(still, robot).any()


def test_joint_powers(trial, robot):
    mechanical, copper = figures.joint_powers(trial.trajectory, robot)
    assert mechanical[0, 1] == pytest.approx(12.0) and mechanical[0, 0] == 0.0
    assert copper[0, 1] > 0.0 and copper[0, 0] == 0.0


def test_a_missing_trajectory_is_refused(make_trial):
    with pytest.raises(SimulationError, match="kept no trajectory"):
        figures.speed_figure(make_trial(), make_trial())


def test_nan_is_refused_with_name_and_time(trial):
    broken = trial.trajectory.joint_velocity.copy()
    broken[250, 3] = np.inf
    with pytest.raises(SimulationError, match=r"joint_velocity at 0\.500 s"):
        require_finite(replace(trial.trajectory, joint_velocity=broken))


def test_the_completed_trial_is_drawn(race, trial):
    fallen = replace(trial, completed=False)
    both = SpeedResult(top_speed=10.0, self_paced=False, trials=(fallen, trial), required=1)
    assert report.representative(both) is trial


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(0.0042, "m", "4.2 mm"), (0.25, "m", "0.25 m"), (0.011, "s", "11 ms"), (float("nan"), "", "-")],
)
def test_audit_values_read_well(value, unit, text):
    assert audit_value(value, unit) == text


def test_a_limit_says_from_which_side_it_bounds():
    item = AuditItem(name="", value=0.03, unit="m", threshold=0.005, passed=False, note="")
    assert audit_limit(item) == "at most 5 mm"
    assert audit_limit(replace(item, bound="at least")) == "at least 5 mm"


def test_a_failure_keeps_the_unit_of_a_limit_that_has_another_one():
    item = AuditItem(name="pad deflection", value=0.18, unit="m", threshold=0.015, passed=False, note="")
    assert audit_failure(item) == "pad deflection 0.18 m: at most 15 mm"


def test_summary_says_whether_it_stopped(race, robot, trial):
    assert not any("still moves" in sentence for sentence in summary(race, robot))
    running = replace(trial, metrics=replace(trial.metrics, final_speed=10.0))
    group = replace(race.raw, trials=(running,))
    lost = replace(race, raw=group)
    assert "At the end of the raw command, which asks it to stand, it still moves at 10.0 m/s." in summary(
        lost, robot
    )


def rows_by_name(race):
    return {row.name: row for row in result_rows(race)}


def test_a_trial_that_runs_on_counts_as_not_stopped_and_not_as_a_fall(race, make_trial):
    running, fallen = replace(make_trial(), completed=False), make_trial(completed=False)
    assert running.fall_reason == "" and fallen.fall_reason
    group = replace(race.raw, trials=(make_trial(), running, running, fallen), required=1)
    assert (len(group.completed), group.falls, group.not_stopped) == (1, 1, 2)
    rows = rows_by_name(replace(race, raw=group))
    assert (rows["falls"].raw, rows["did not stop"].raw) == ("1 of 4", "2 of 4")
    assert rows["did not stop"].self_paced == "0 of 2" and "0.3 m/s" in rows["did not stop"].meaning
    assert replace(race, raw=group).to_dict()["not_stopped"] == 2


def test_the_battery_row_says_speed_voltage_and_windings(race, make_trial):
    name = "held speed on battery and warm windings"
    assert name not in rows_by_name(race) and race.to_dict()["battery"] is None
    trial = make_trial()
    supplied = replace(trial.metrics, held_speed=9.5, lowest_bus_voltage=47.25, hottest_winding=88.4)
    raced = replace(race, battery=replace(trial, metrics=supplied))
    row = rows_by_name(raced)[name]
    assert row.raw == "9.50" and row.self_paced == ""
    assert "down to 47.2 V" in row.meaning and "up to 88 °C" in row.meaning
    numbers = raced.to_dict()["battery"]
    assert (numbers["held_speed_m_s"], numbers["lowest_bus_voltage_V"]) == (9.5, 47.25)
    assert numbers["completed"] is True and numbers["hottest_winding_degC"] == 88.4
    assert battery_text(raced.battery) == "9.50 (down to 47.2 V, up to 88 °C)"


def test_beside_a_fall_stand_full_drives_and_the_lowest_bus_voltage(make_trial):
    trial = make_trial(completed=False)
    full = (("FL_knee", 2.1), ("RR_knee", 2.8))
    metrics = replace(trial.metrics, i2t_full=full, lowest_bus_voltage=19.4, lowest_bus_time=1.5)
    assert fall_text(replace(trial, metrics=metrics)) == (
        "fell at 3.0 s (tilt); I²t full: FL_knee at 2.1 s, RR_knee at 2.8 s; bus down to 19.4 V at 1.5 s"
    )
    assert fall_text(trial) == "fell at 3.0 s (tilt)"


def test_the_battery_trial_is_the_nominal_raw_one_and_goes_where_all_are_supplied():
    request = battery_request(9.0, ProtocolSettings(hold=3.0))
    assert (request.top_speed, request.hold, request.self_paced) == (9.0, 3.0, False)
    assert request.plant.battery == "robot" and request.plant.heat == WindingHeat()
    assert request.settings == NOMINAL_TRIAL
    assert battery_request(9.0, ProtocolSettings(plant=PlantOptions(heat=WindingHeat()))) is None


def test_held_says_whether_it_was_steady(race, robot, trial):
    assert any(sentence.endswith("as commanded; steady.") for sentence in summary(race, robot))
    rising = replace(trial, metrics=replace(trial.metrics, hold_acceleration=0.5))
    group = replace(race.raw, trials=(rising,))
    page = report.render_report(replace(race, raw=group), robot, [])
    assert "held speed, not steady: still rising by 0.50 m/s per second" in page
    numbers = replace(race, raw=group).to_dict()
    assert numbers["held_steady"] is False and numbers["hold_acceleration_m_s2"] == 0.5
    assert numbers["self_paced"]["held_steady"] is True


def test_a_time_outside_the_lane_carries_a_mark(race, robot, trial):
    wide = replace(trial, metrics=replace(trial.metrics, lane_excursion=2.0))
    left = replace(race, sprint=replace(race.sprint, trial=wide))
    page = report.render_report(left, robot, [])
    assert "90 m, raw command, left its lane" in page and "9.00 (left its lane)" in page
    assert "in 9.00 s with the raw command (left its lane)" in page
    numbers = left.to_dict()
    assert numbers["left_lane"] is True and numbers["left_lane_self_paced"] is False
    assert "left its lane" not in report.render_report(race, robot, [])


def test_summary_says_what_was_measured(race, robot):
    text = " ".join(summary(race, robot))
    assert "ran 90 m in 9.00 s with the raw command." in text
    assert "s self-paced" not in text  # it did not finish
    assert "2 of 4 seeded trials fell" in text
    assert "Every check of the exploit audit passed." in text


def test_summary_does_not_hide_a_failed_audit(race, robot, trial):
    sunk = audit_trials([replace(trial.metrics, pad_deflection=0.05)])
    text = " ".join(summary(replace(race, audit=sunk), robot))
    assert "pad deflection 50 mm: at most 15" in text and "not to be trusted" in text


def test_summary_of_a_race_in_which_everything_failed(race, robot, make_trial):
    fallen = replace(race.raw, trials=(make_trial(completed=False),), required=1)
    unfinished = replace(race.sprint, time=float("nan"))
    lost = replace(race, raw=fallen, self_paced=fallen, sprint=unfinished, sprint_self_paced=unfinished)
    text = " ".join(summary(lost, robot))
    assert "did not finish the 90 m" in text and "2 of 2 seeded trials fell" in text
    assert "nan" not in text + report.render_report(lost, robot, [])


def test_results_carry_their_spread(race, trial):
    faster = replace(trial, metrics=replace(trial.metrics, held_speed=trial.metrics.held_speed + 1.0))
    several = replace(race.raw, trials=(trial, faster))
    rows = {row.name: row for row in result_rows(replace(race, raw=several))}
    assert rows["held speed"].raw == f"{trial.metrics.held_speed + 0.5:.2f} ± 0.71"
    assert "±" not in rows["held speed"].self_paced  # one completed trial has no spread
    assert rows["falls"].raw == "0 of 2"


def test_setup_names_robot_and_trials(race, robot):
    rows = dict(setup_rows(race, robot))
    assert rows["robot"].startswith("bp2, 36.5 kg, 12 motors")
    assert "1 must complete" in rows["trials"]


def test_figures_and_tables_are_numbered(page):
    assert "Figure 1" in page and "Table 1" in page
    targets = re.findall(r'href="#([\w-]+)"', page)
    assert targets and all(f'id="{target}"' in page for target in targets)


def test_a_taken_folder_name_gets_a_number(tmp_path):
    first = default_folder(tmp_path)
    first.mkdir()
    assert default_folder(tmp_path) != first


# --- video -------------------------------------------------------------------------------------------------


def test_slow_motion_follows_the_run():
    options = video.VideoOptions(frames_per_second=25, slow_motion=0.4, slow_factor=5.0)
    run, slow = split_frames(video.frame_times(8.0, (3.0, 7.0), options))
    assert len(run) == 200 and run[-1] == pytest.approx(7.96)
    assert len(slow) == 50 and slow[0] == pytest.approx(4.8) and slow[-1] < 5.2
    assert not any(slow for _, slow in video.frame_times(1.0, (0.9, 1.0), options))


def split_frames(frames):
    return [moment for moment, slow in frames if not slow], [moment for moment, slow in frames if slow]


def test_a_slow_machine_shows_the_whole_run_in_plainer_pictures():
    first, *_, last = video.plainer(video.VideoOptions())
    assert (first.width, last.width, last.shadows) == (1280, 640, False)
    for options in video.plainer(video.VideoOptions()):
        run, _ = split_frames(video.frame_times(15.0, (5.0, 12.0), options))
        assert run[-1] == pytest.approx(15.0, abs=0.05)
        assert options.frames_per_second >= 30


def test_video_options_are_checked():
    with pytest.raises(InvalidValueError, match=r"video\.width"):
        video.VideoOptions(width=0)


def test_a_recording_is_whole_or_not_there(trial, tmp_path, monkeypatch):
    """It goes through no link, waits for no pipe, and a full disk leaves the old one."""
    (tmp_path / "mine").write_text("old")
    (tmp_path / "run.npz").symlink_to("mine")
    save_trajectory(tmp_path / "run.npz", trial.trajectory)
    assert (tmp_path / "mine").read_text() == "old" and "time" in np.load(tmp_path / "run.npz")
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(SprintlabError, match="a pipe, a device"):
        save_trajectory(tmp_path / "pipe.npz", trial.trajectory)

    def full_disk(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    before = (tmp_path / "run.npz").read_bytes()
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(SprintlabError, match="No space left"):
        save_trajectory(tmp_path / "run.npz", trial.trajectory)
    assert (tmp_path / "run.npz").read_bytes() == before


def test_without_a_backend_one_line_says_what_to_install(trial, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "no-such-backend")
    monkeypatch.setattr(video, "has_encoder", lambda: True)
    save_trajectory(tmp_path / "run.npz", trial.trajectory)
    message = video.render_video(tmp_path / "run.npz", tmp_path / "run.mp4", "bp2", (3.0, 7.0))
    assert message == video.INSTALL_BACKEND and "\n" not in message
    assert not (tmp_path / "run.mp4").exists()


def test_without_an_encoder_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "has_encoder", lambda: False)
    message = video.render_video(tmp_path / "run.npz", tmp_path / "run.mp4", "bp2", (3.0, 7.0))
    assert message == video.INSTALL_ENCODER and "pip install" in message


def test_a_video_is_rendered_where_a_backend_works(trial, tmp_path):
    if not video.has_encoder() or video.working_gl_backend() is None:
        pytest.skip("no OpenGL backend or no encoder here")
    short = {name: values[:60] for name, values in trial.trajectory.arrays().items()}
    np.savez(tmp_path / "run.npz", **short)
    assert video.render_video(tmp_path / "run.npz", tmp_path / "run.mp4", "bp2", (0.0, 0.05)) == ""
    assert (tmp_path / "run.mp4").read_bytes()[4:8] == b"ftyp"


JUMPS = """
import sys
import mujoco
import numpy as np
from sprintlab.evaluation.video import VideoOptions, _Scene
from sprintlab.robots import ModelOptions, build_model, load_robot
model = build_model(load_robot("bp2"), ModelOptions(visuals=True))
options = VideoOptions(width=320, height=176)
with mujoco.Renderer(model, options.height, options.width) as renderer:
    scene = _Scene(model, renderer, dict(np.load(sys.argv[1])), (2.0, 9.0), options)
    for moment in (1.0, 9.0, 1.0):
        ground = scene.frame(moment, False)[100:140].astype(int)
        print(np.mean(ground[..., 0] > ground[..., 2]))
"""


def test_the_track_is_under_the_robot_after_a_jump_in_time(trial, tmp_path):
    """From the run to its slow motion, and to the first frame of a shortened video."""
    backend = video.working_gl_backend()
    if backend is None:
        pytest.skip("no OpenGL backend here")
    np.savez(tmp_path / "run.npz", **trial.trajectory.arrays())
    environment = dict(os.environ) if backend == "default" else dict(os.environ, MUJOCO_GL=backend)
    command = [sys.executable, "-c", JUMPS, str(tmp_path / "run.npz")]
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert len(shown.split()) == 3 and all(float(share) > 0.7 for share in shown.split())


@pytest.mark.parametrize(
    ("failed", "verdict"),
    [
        ((), "passed"),
        ((CLOCK_ITEM,), "by the clock alone: evaluate --clock-check"),
        ((CLOCK_ITEM, "smallest leg distance"), "FAILED 2 of 2 checks: do not trust the speeds"),
        (("smallest leg distance",), "do not trust the speeds"),
    ],
)
def test_the_verdict_tells_a_clock_from_an_exploit(failed, verdict):
    names = (CLOCK_ITEM, "smallest leg distance")
    items = [
        AuditItem(name=name, value=0.0, unit="m", threshold=0.0, passed=name not in failed, note="")
        for name in names
    ]
    assert verdict in audit_verdict(AuditReport(items=tuple(items)))
