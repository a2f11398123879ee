"""The converter of other people's benches, on small made-up files of the same layout."""

import dataclasses
import subprocess

import numpy as np
import pytest
from tools import fetch_bench_data as fetch

from sprintlab.workbench.identification import load_bench

FUTEK = """# Test started at Tue Jan 01 00:00:00 2030
# kt_1 = 0.1; kt_2 = 0.1
time [s],a1 q-axis cmd [A],a1 q-axis [A],a1 velocity [rad/s],a2 q-axis cmd [A],a2 q-axis [A],\
a2 velocity [rad/s],c1 torque [Nm],c2 torque [Nm],trs605-5 torque [Nm],motor temp [C],housing temp [C],
0.00,0.0,0.01,0.0,0.0,0.02,0.0,0.0,0.0,-0.04,30.0,29.0
0.01,5.0,4.90,50.0,0.0,3.80,-50.0,0.54,0.42,0.43,31.0,29.0
0.02,5.0,5.10,51.0,0.0,3.90,-51.0,0.56,0.43,0.44,31.5,29.0
0.03,0.0,-3.70,40.0,-5.0,-4.95,-40.0,-0.40,-0.55,-0.50,32.0,29.0
0.04,0.0,-3.70
"""
ODRIVE = """2030-01-01 00:00:00
Input voltage, Input current, Input Power, Test Motor Temperature, Test motor q-axis current, \
Test motor d-axis current, Test motor Ibus, Output Torque, Output Speed
V, mA, W, Deg C, A, A, A, N.mm, rad.s
48.0, 0, 0.0, 25.5, -37.5, 0.1, 1.5, -1093.0, -10.4
47.5, 0, 0.0, 26.5, -1.6, 0.2, 0.1, -15.2, 10.6
"""
PROFILES = """
raise RuntimeError("this code must not run")

class ShortCurrentTimeProfile(CurrentTimeProfile):
    def getCurrentAtTime(self, time):
        if (time < 40.):
            return 16.5
        elif (time >= 40 and time < 80):
            return 0
        elif (time >= 80 and time < 120):
            return 14.
        else:
            return 0

run = TemperatureDataset(filepath = './data/runA.csv', initialTemperature = 22.8, ambientTemperature = 21.3,
                         currentScript = ShortCurrentTimeProfile())
"""


def saved(tmp_path, table, name="bench.csv"):
    path = tmp_path / name
    path.write_text(fetch.table_text(fetch.SOURCES["ri50"], "log.csv", table), encoding="utf-8")
    return path


def test_a_shaft_with_two_drives_becomes_a_bench_for_each_motor_and_role(tmp_path):
    tables = fetch.ri50_tables(FUTEK, "log")
    assert set(tables) == {f"log-{motor}{role}" for motor in "12" for role in ("", "-drives", "-brakes")}
    bench = load_bench(saved(tmp_path, tables["log-1-drives"]))
    np.testing.assert_allclose(bench.current, [4.9, 5.1])
    np.testing.assert_allclose(bench.torque, [0.43, 0.44])
    np.testing.assert_allclose(bench.speed, [50.0, 51.0])
    np.testing.assert_allclose(bench.time, [0.01, 0.02])
    np.testing.assert_allclose(bench.temperature, [31.0, 31.5])
    assert bench.unused == ("estimate of the drive [N m]",)
    braking = load_bench(saved(tmp_path, tables["log-1-brakes"]))
    np.testing.assert_allclose(braking.current, [-3.7])
    other = load_bench(saved(tmp_path, tables["log-2-drives"]))
    np.testing.assert_allclose((other.current[0], other.speed[0], other.torque[0]), (-4.95, -40.0, -0.5))
    assert load_bench(saved(tmp_path, tables["log-2"])).size == 4


def test_currents_are_read_out_of_code_that_is_not_run():
    table = fetch.ak_profiles(PROFILES)["runA-current"]
    np.testing.assert_allclose(table["until [s]"], [40.0, 80.0, 120.0, 1e9])
    np.testing.assert_allclose(table["current [A]"], [16.5, 0.0, 14.0, 0.0])
    np.testing.assert_allclose(table["ambient [degC]"], 21.3)


def git(folder, *arguments):
    identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "core.autocrlf=false")
    return subprocess.check_output(["git", "-C", folder, *identity, *arguments], text=True).strip()


def test_a_clone_is_read_at_the_commit_of_the_results(tmp_path, monkeypatch, capsys):
    """Whatever is checked out: the file may have left the repository since."""
    clone, out = tmp_path / "clone", tmp_path / "out"
    (clone / "data").mkdir(parents=True)
    (clone / "data" / "a.csv").write_bytes(ODRIVE.encode())
    git(clone, "init", "-q")
    git(clone, "add", ".")
    git(clone, "commit", "-qm", "data")
    commit = git(clone, "rev-parse", "HEAD")
    git(clone, "rm", "-q", "data/a.csv")
    git(clone, "commit", "-qm", "gone")
    made_up = {"folder": "data", "files": {"points": "a.csv"}, "commit": commit}
    source = dataclasses.replace(fetch.SOURCES["d5065"], **made_up)
    monkeypatch.setitem(fetch.SOURCES, "d5065", source)
    assert fetch.main(["d5065", str(clone), "--output", str(out)]) == 0
    bench = load_bench(out / "d5065-points.csv")
    assert bench.size == 2 and bench.torque[0] == pytest.approx(-1.093)
    assert source.repository in (out / "d5065-points.csv").read_text(encoding="utf-8").splitlines()[0]
    assert fetch.main(["d5065", str(tmp_path), "--output", str(out)]) == fetch.REFUSED
    assert "does not have data/a.csv: clone" in capsys.readouterr().err
