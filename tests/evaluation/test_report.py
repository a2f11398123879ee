"""Figures and report of a race."""

import base64
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sprintlab.evaluation import figures, report, video
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.metrics import on_envelope
from sprintlab.evaluation.race_files import save_trajectory
from sprintlab.evaluation.results import (
    RaceResult,
    SpeedResult,
    SprintResult,
)


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
    tiny = report.Picture(name="speed", title="Speed", caption="Look.", png=b"picture")
    return report.render_report(race, robot, [tiny], [("command", "sprintlab race")], video_message="no GL")


def test_every_picture_is_a_png(race, robot):
    drawn = []
    pictures = report.draw_pictures(report.planned_figures(race, robot), drawn.append)
    assert len(pictures) == len(drawn) == 6
    for picture in pictures:
        assert Image.open(io.BytesIO(picture.png)).width > 900


def test_the_report_is_one_file_that_loads_nothing_and_says_what_happened(page):
    assert not re.findall(r"""(?:src|srcset|href)=["'](?!data:|#)""", page) and "http" not in page
    assert base64.b64encode(b"picture").decode() in page
    assert "test &lt;policy&gt;" in page  # escaped
    assert "not finished" in page and "9.00" in page
    assert "1 of 2" in page and "fell at 3.0 s (tilt)" in page
    assert "no GL" in page and "<video" not in page
    assert "exploit audit passed" in page and "1 must complete" in page
    targets = re.findall(r'href="#([\w-]+)"', page)
    assert targets and all(f'id="{target}"' in page for target in targets)


def test_a_failed_audit_is_marked(race, robot, trial):
    sunk = replace(race, audit=audit_trials([replace(trial.metrics, pad_deflection=0.05)]))
    page = report.render_report(sunk, robot, [], video=b"film")
    assert "exploit audit FAILED 1 of 15 checks" in page and ">FAIL<" in page
    first_screen = page[: page.index('<div class="tiles">')]
    assert "<li>pad deflection 50 mm: at most 15</li>" in first_screen
    assert f"data:video/mp4;base64,{base64.b64encode(b'film').decode()}" in page


def test_figures_show_contacts_costs_and_samples_on_the_envelope(trial, robot):
    axis = figures.gait_figure(trial, robot).axes[0]
    labels = [label.get_text() for label in axis.get_yticklabels()]
    assert [label.split()[0] for label in labels] == list(robot.leg_names)
    assert all(22 <= float(label.split()[1]) <= 28 for label in labels)
    curve = figures.rates_figure(trial).axes[2].lines[0].get_ydata()
    assert curve[-1] == pytest.approx((2.0**2 + 1.0**2) * 9.998)
    touched = on_envelope(trial.trajectory)
    assert touched[:, 1].all() and not np.delete(touched, 1, axis=1).any()
    still = replace(trial.trajectory, command=np.zeros((5000, 3)))
    assert not on_envelope(still).any()


def test_what_qualifies_a_speed_stands_in_the_numbers_and_in_the_report(race, robot, trial, make_trial):
    def but(**values):
        return replace(trial, metrics=replace(trial.metrics, **values))

    running = replace(but(final_speed=10.0), completed=False)
    moving = replace(race.raw, trials=(trial, running, running, make_trial(completed=False)))
    rising = replace(race.raw, trials=(but(hold_acceleration=0.5),))
    outside = replace(race.sprint, trial=but(lane_excursion=2.0))
    plain = report.render_report(race, robot, [])
    for changes, key, value, words in (
        ({"raw": moving}, "not_stopped", 2, "2 of 4"),
        ({"raw": rising}, "held_steady", False, "not steady: still rising by 0.50 m/s per second"),
        ({"sprint": outside}, "left_lane", True, "9.00 (left its lane)"),
    ):
        changed = replace(race, **changes)
        assert changed.to_dict()[key] == value != race.to_dict()[key]
        assert words in report.render_report(changed, robot, []) and words not in plain


def test_a_race_of_which_nothing_is_known_has_no_nan_in_its_report(race, robot, make_trial):
    fallen = replace(race.raw, trials=(make_trial(completed=False),))
    unfinished = replace(race.sprint, time=float("nan"))
    lost = replace(race, raw=fallen, self_paced=fallen, sprint=unfinished, sprint_self_paced=unfinished)
    assert "nan" not in report.render_report(lost, robot, [])


@pytest.fixture
def recording(trial, robot, tmp_path):
    save_trajectory(tmp_path / "run.npz", trial.trajectory, robot.joint_names)
    return tmp_path / "run.npz", tmp_path / "run.mp4"


def test_a_video_is_rendered_where_a_backend_works(trial, recording):
    if not video.has_encoder() or video.working_gl_backend() is None:
        pytest.skip("no OpenGL backend or no encoder here")
    np.savez(recording[0], **{name: values[:60] for name, values in trial.trajectory.arrays().items()})
    assert video.render_video(*recording, "bp2", 0.05) == ""
    assert recording[1].read_bytes()[4:8] == b"ftyp"
