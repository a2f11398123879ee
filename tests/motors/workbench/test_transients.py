"""Raw logs of a drive: steady windows, what is left out, and the inertia that only transients show."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.motors.workbench.benches import bench as rows

from sprintlab.cli.main import main
from sprintlab.core.errors import SprintlabError
from sprintlab.workbench.identification import identify, is_log, rested

PAIRS, FLUX, SATURATION, PEAK = 7, 0.011, 0.16, 20.0
CONSTANT = 1.5 * PAIRS * FLUX
COULOMB, VISCOUS, INERTIA = 0.02, 2e-4, 3e-4
RATE = 100.0


def log(seed, rate=RATE, step=1.0, settling=0.1, torque_lag=0.03):
    """A stair of currents whose speed and torque settle slowly: a bench as recorded, rows at ``rate``."""
    random = np.random.default_rng(seed)
    levels = random.permutation(np.tile(np.linspace(-16.0, 16.0, 9), 6))
    time = np.arange(int(len(levels) * step * rate)) / rate
    asked = np.repeat(levels, int(step * rate))
    aim = np.repeat(random.uniform(-100.0, 100.0, len(levels)), int(step * rate))
    speed = lagged(aim, settling * rate)
    acceleration = np.gradient(speed, 1.0 / rate)
    torque = CONSTANT * asked * (1.0 - SATURATION * np.abs(asked) / PEAK)
    torque = torque - COULOMB * np.sign(speed) - VISCOUS * speed - INERTIA * acceleration
    torque = lagged(torque, torque_lag * rate) + random.normal(0.0, 0.004, len(time))
    return time, asked + random.normal(0.0, 0.3, len(time)), speed, torque


def lagged(values, rows):
    share, found, now = 1.0 - np.exp(-1.0 / rows), np.empty(len(values)), values[0]
    for index, value in enumerate(values):
        now += share * (value - now)
        found[index] = now
    return found


def bench(time, current, speed, torque):
    return rows(current, torque, speed, time=time)


def fitted(data, **options):
    return identify(data, pole_pairs=PAIRS, peak_current=PEAK, **options)


def test_steady_windows_tell_the_motor_and_all_rows_do_not():
    data = bench(*log(1))
    found = fitted(rested(data))
    assert found.trustworthy
    estimates = found.estimates
    assert abs(found.torque_constant / CONSTANT - 1.0) < 0.01
    assert abs(estimates["saturation"].value - SATURATION) < 0.02
    assert abs(estimates["coulomb_friction"].value - COULOMB) < 0.004
    raw = fitted(replace(data, time=None))
    assert raw.channels[0].noise > 3.0 * found.channels[0].noise


def test_the_inertia_of_the_rotor_comes_from_the_transients():
    data = bench(*log(4, settling=0.25, torque_lag=1e-6))
    moving = rested(data, 0.05, speed_may_change=True)
    found = fitted(moving, also=("rotor_inertia",))
    inertia = found.estimates["rotor_inertia"]
    assert inertia.determined and abs(inertia.value / INERTIA - 1.0) < 0.1
    values = {"stator_resistance": 0.1, "q_axis_inductance": 1e-4}
    determined = replace(inertia, value=0.0, half_width=0.0)
    complete = found.estimates | {name: replace(determined, name=name, value=v) for name, v in values.items()}
    assert replace(found, estimates=complete).motor().rotor_inertia == inertia.value


def test_what_no_window_can_use_is_refused_in_a_sentence():
    time, current, speed, torque = log(7)
    for rate, expected in ((100.0, True), (15.0, False)):  # steady points with a time are no log
        assert is_log(bench(time * RATE / rate, current, speed, torque)) == expected
    swinging = 16.0 * np.sin(2.0 * np.pi * 4.0 * time)
    with pytest.raises(SprintlabError, match=r"rests nowhere.*--window"):
        rested(bench(time, swinging, 100.0 * np.cos(2.0 * np.pi * 4.0 * time), torque))
    backwards = time.copy()
    backwards[77] = 0.0
    with pytest.raises(SprintlabError, match="backwards in line 79"):
        rested(bench(backwards, current, speed, torque))


def test_the_command_reads_a_log_and_says_how_it_was_read(tmp_path, capsys):
    time, current, speed, torque = log(9)
    rows = np.stack((1e3 * time, current, speed, torque), axis=-1)
    header, path = "time [ms],iq [A],speed [rad/s],torque [N m]", tmp_path / "log.csv"
    np.savetxt(path, rows, "%.6f", ",", header=header, comments="")
    words = ["motor", "identify", str(path), "--pole-pairs", "7", "--peak-current", "20", "--json"]
    assert main(words) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert abs(numbers["torque_constant"] / CONSTANT - 1.0) < 0.01
    assert "windows of 0.1 s rest" in numbers["warnings"][0]
