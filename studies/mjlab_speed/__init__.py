"""What a motor law is worth in mjlab: its own Go1 task, with faster commands, on three actuators.

Each run trains mjlab's flat velocity task with mjlab's and rsl_rl's own code; only the actuator differs and
the range of commanded speeds, which rises while robots follow, until the motors are the limit. All runs begin
with the networks of one that has learned to walk on mjlab's own actuators. The actuators are:

- ``stock``: mjlab's position actuators with a torque limit (``BuiltinPositionActuatorCfg``);
- ``data-sheet``: mjlab's brushed DC motor from stall torque and no-load speed (``DcMotorDatasheetParams``);
- ``refined``: the motor law of this package (``PmsmActuatorCfg``).

Every policy is then judged on one plant, MuJoCo C with the motors of our Go1: under the law that it was
trained with (what was promised) and under the refined law (what its motors give). So is the package's own
``go1-sprint``, which runs faster than mjlab's task: it shows from which speed the law matters.

    python -m studies.mjlab_speed train --output results/mjlab-speed   # again until it prints "left: nothing"
    python -m studies.mjlab_speed judge results/mjlab-speed            # needs no GPU
    python -m studies.mjlab_speed page results/mjlab-speed docs       # figure and section
"""
