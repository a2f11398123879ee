"""The paper's figures: every one is drawn from the material that there is, and refused material is named."""

import dataclasses

import numpy as np
import pytest
from studies.paper import figures, gallery
from studies.paper.gallery import Gallery, gallery_text, read_curve, write_gallery
from studies.paper.measure import Candidate
from studies.paper.runs import find_runs

from sprintlab.core.errors import SprintlabError
from sprintlab.core.theme import png_bytes
from sprintlab.evaluation.results import SprintResult

PNG = b"\x89PNG"


@pytest.fixture
def run(make_trial, make_trajectory):
    """A finished run with some motion in its joints."""

    def build(**arrays):
        trajectory = make_trajectory(2.0, **arrays)
        wave = np.sin(40.0 * trajectory.time)[:, None]
        moving = dataclasses.replace(
            trajectory, joint_velocity=40.0 * wave * np.ones(12), motor_torque=14.0 * wave * np.ones(12)
        )
        return dataclasses.replace(make_trial(), trajectory=moving)

    return build


@pytest.fixture
def drawn(monkeypatch, run):
    """The simulations replaced; what was asked for is kept."""
    asked = []

    def trial(policy, robot, request, course=None):
        asked.append(course.mode if course is not None else request.plant.motor_model)
        return run()

    def sprint(policy, robot, request):
        asked.append(f"{request.distance:g} m")
        return SprintResult(distance=100.0, time=11.0, trial=run())

    monkeypatch.setattr(gallery, "run_trial", trial)
    monkeypatch.setattr(gallery, "run_course", trial)
    monkeypatch.setattr(gallery, "run_sprint", sprint)
    return asked


@pytest.fixture
def unpainted(monkeypatch):
    """Figures are made and not painted, where a test is about which ones there are."""
    monkeypatch.setattr(gallery, "png_bytes", lambda figure, dpi: PNG)


def candidate(policy, method="sprint"):
    return Candidate(method=method, seed=0, policy=policy)


def test_every_figure_of_one_policy(drawn, standing_policy, robot, tmp_path):
    main = candidate(standing_policy)
    shown = []
    drawings = write_gallery(
        Gallery(robot=robot, policies=(main,), runs=(), main=main),
        tmp_path / "figures",
        lambda what, share: shown.append(share),
    )
    assert [one.name for one in drawings] == ["envelopes", "worlds-sprint", "command-modes", "sprint"]
    text = gallery_text(drawings, "figures")
    for drawing in drawings:
        path = tmp_path / "figures" / f"{drawing.name}.png"
        assert path.read_bytes().startswith(PNG) and path.stat().st_size < 200_000
        assert f"](figures/{drawing.name}.png)" in text and drawing.caption in text
    assert drawn == ["square", "refined", "uniform", "fixed-acceleration", "adaptive", "step", "100 m"]
    assert shown == sorted(shown) and shown[0] == 0.0


def test_policies_trained_with_another_motor_are_shown_in_their_own_world(
    drawn, unpainted, standing_policy, make_policy, robot, monkeypatch, tmp_path
):
    models = {"no-envelope": "square", "simplified-dc": "simplified-dc", "sprint": "refined"}
    monkeypatch.setattr(gallery, "_training_model", lambda one: models[one.method])
    policies = tuple(candidate(standing_policy, method) for method in models)
    drawings = write_gallery(Gallery(robot=robot, policies=policies, runs=(), main=policies[-1]), tmp_path)
    assert [one.name for one in drawings][1:3] == ["worlds-no-envelope", "worlds-simplified-dc"]
    assert drawn[:4] == ["square", "refined", "simplified-dc", "refined"]


def test_curves_of_finished_runs_make_a_learning_figure(drawn, unpainted, standing_policy, robot, tmp_path):
    for seed in range(2):
        folder = tmp_path / "runs" / "sprint" / f"seed-{seed}"
        folder.mkdir(parents=True)
        rows = "".join(f"{step},{10 * step},{0.1 * step + seed}\n" for step in range(50))
        (folder / "curve.csv").write_text("iteration,seconds,speed_p999\n" + rows)
    main = candidate(standing_policy)
    runs = tuple(find_runs(tmp_path / "runs"))
    drawings = write_gallery(Gallery(robot=robot, policies=(main,), runs=runs, main=main), tmp_path)
    assert drawings[-1].name == "learning" and (tmp_path / "learning.png").is_file()
    assert png_bytes(drawings[-1].draw(), dpi=gallery.DPI).startswith(PNG)


@pytest.fixture
def clouded(cloud_arrays, tmp_path):
    """Runs of two methods, each with the cloud of its training."""
    for method in ("sprint", "no-envelope"):
        folder = tmp_path / "runs" / method / "seed-0"
        folder.mkdir(parents=True)
        np.savez(folder / "cloud.npz", **cloud_arrays)
    return tmp_path / "runs"


def sprint_drawing(policies, runs, robot):
    """The drawing of the sprint, without the others, which take seconds to write."""
    material = Gallery(robot=robot, policies=policies, runs=tuple(find_runs(runs)), main=policies[0])
    return next(one for one in gallery._drawings(material) if one.name == "sprint")


def test_training_and_evaluation_stand_side_by_side(drawn, clouded, standing_policy, robot):
    policies = (candidate(standing_policy), candidate(standing_policy, "no-envelope"))
    drawing = sprint_drawing(policies, clouded, robot)
    assert drawing.caption.startswith("`sprint` and `no-envelope`: for each, left the last two seconds")
    figure = drawing.draw()
    assert png_bytes(figure).startswith(PNG)
    assert len(figure.axes) == 12
    titles = [axis.get_title(loc="left") for axis in figure.axes[:4]]
    assert titles == [
        "sprint: training",
        "sprint: evaluation",
        "no-envelope: training",
        "no-envelope: evaluation",
    ]
    assert figure.axes[0].get_title(loc="right") == "square (ideal motor)"
    assert figure.axes[4].get_title(loc="right") == "25 % on the limit, 50 % impossible"


def test_a_cheat_without_a_cloud_is_left_out(drawn, clouded, standing_policy, robot):
    (clouded / "no-envelope" / "seed-0" / "cloud.npz").unlink()
    policies = (candidate(standing_policy), candidate(standing_policy, "no-envelope"))
    drawing = sprint_drawing(policies, clouded, robot)
    assert drawing.caption.startswith("`sprint`: for each") and len(drawing.draw().axes) == 6


def test_without_a_cloud_of_its_own_run_the_caption_says_so(drawn, clouded, standing_policy, robot):
    (clouded / "sprint" / "seed-0").rename(clouded / "sprint" / "seed-1")  # not the policy's seed
    drawing = sprint_drawing((candidate(standing_policy),), clouded, robot)
    assert "The cloud of the training is not shown" in drawing.caption and len(drawing.draw().axes) == 3


def test_a_cloud_of_another_robot_is_refused(drawn, clouded, cloud_arrays, standing_policy, robot):
    path = clouded / "sprint" / "seed-0" / "cloud.npz"
    np.savez(path, **(cloud_arrays | {"robot": np.array("go1")}))
    with pytest.raises(SprintlabError, match="is of robot go1, and the figures are of bp2"):
        sprint_drawing((candidate(standing_policy),), clouded, robot).draw()


def test_an_estimate_is_drawn_against_the_truth(run):
    estimate = np.zeros((1000, 8))
    figure = figures.estimate_figure(run(estimate=estimate))
    assert len(figure.axes) == 5 and len(figure.axes[0].lines) == 2


def test_what_the_real_motor_cannot_give_is_marked(run, robot):
    figure = figures.worlds_figure([("ideal", run()), ("real", run())], robot)
    texts = [axis.get_title(loc="right") for axis in figure.axes]
    share = float(texts[2].split(", ")[1].split(" %")[0])
    assert 5.0 < share < 60.0  # 14 N m up to 40 rad/s: past the critical speed the real motor gives less


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("iteration,seconds\n1,2\n", "speed_p999"),
        ("seconds,speed_p999\n1,fast\n", "fast"),
        ("seconds,speed_p999\n1\n", "no learning curve"),
        ("seconds,speed_p999\n", "no rows"),
        ("seconds,speed_p999,seconds\n1,2,3\n", "stands twice"),
        ("seconds,speed_p999\n1_0,2\n", "line 2, column seconds: '1_0' is no finite number"),
        ("seconds,speed_p999\n\u0661,2\n", "is no finite number"),
        ("seconds,speed_p999\n1,nan\n", "is no finite number"),
    ],
)
def test_a_damaged_curve_is_refused(tmp_path, text, words):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(SprintlabError, match=words):
        read_curve(path)
    with pytest.raises(SprintlabError, match="cannot read"):
        read_curve(tmp_path / "none.csv")
