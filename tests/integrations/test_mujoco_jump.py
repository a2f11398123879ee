"""The example of plain MuJoCo: a jump on a stand-in for Menagerie's Go2, joints and actuators alike."""

import json
import sys

import pytest

LEGS = {"FR": (0.19, -0.14), "FL": (0.19, 0.14), "RR": (-0.19, -0.14), "RL": (-0.19, 0.14)}
PEAKS = {"hip": 23.7, "thigh": 23.7, "calf": 45.43}


def stand_in():
    legs, motors = "", ""
    for leg, (x, y) in LEGS.items():
        legs += (
            f"<body pos='{x} {y} 0'><joint name='{leg}_hip_joint' axis='1 0 0'/><geom size='.04' mass='.7'/>"
            f"<body><joint name='{leg}_thigh_joint' axis='0 1 0'/>"
            "<geom type='capsule' fromto='0 0 0 0 0 -.213' size='.015' mass='1.1' contype='0'/>"
            f"<body pos='0 0 -.213'><joint name='{leg}_calf_joint' axis='0 1 0' range='-2.72 -.83'/>"
            "<geom type='capsule' fromto='0 0 0 0 0 -.2' size='.01' mass='.24' contype='0'/>"
            "<geom pos='0 0 -.213' size='.022' mass='.01' friction='.8'/></body></body></body>"
        )
        motors += "".join(
            f"<motor joint='{leg}_{part}_joint' ctrlrange='-{peak} {peak}'/>" for part, peak in PEAKS.items()
        )
    pose = " ".join(["0 0.9 -1.8"] * 4)
    return (
        "<mujoco><compiler angle='radian' autolimits='true'/><default>"
        "<joint damping='2' armature='.01'/></default><asset><mesh name='shell' file='shell.obj'/></asset>"
        "<worldbody><body pos='0 0 .4'><freejoint/><geom type='box' size='.19 .05 .06' mass='6.9'/>"
        f"<geom type='mesh' mesh='shell' contype='0' conaffinity='0'/>{legs}</body></worldbody>"
        f"<actuator>{motors}</actuator>"
        f"<keyframe><key qpos='0 0 .28 1 0 0 0 {pose}'/></keyframe></mujoco>"
    )


@pytest.fixture
def example(load_script, tmp_path):
    (tmp_path / "go2.xml").write_text(stand_in())
    return load_script("examples/mujoco_go2_jump.py")


def test_it_runs_from_the_command_line(example, tmp_path, monkeypatch, capsys):
    figure = tmp_path / "jump.png"
    arguments = ["mujoco_go2_jump.py", str(tmp_path / "go2.xml"), "--figure", str(figure), "--json"]
    monkeypatch.setattr(sys, "argv", arguments)
    example.main()
    found = json.loads(capsys.readouterr().out)
    assert found["rise_refined_m"] < found["rise_dcmotor_m"] < found["rise_own_m"]
    assert figure.read_bytes().startswith(b"\x89PNG")
