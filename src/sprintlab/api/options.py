"""Arguments that mean the same in several commands."""

OPTIONS = {
    "policy": "a policy file, or the name of a policy that comes with the package.",
    "robot": "a robot's name, folder or parameter table (.toml); the policy's when left out.",
    "source": "a motor file or a data sheet (TOML), the name of a robot, or an actuator of the library.",
    "joint": "which motor of the robot: abad, hip, knee, or a full name such as RL_hip.",
    "bus_voltage": "bus voltage [V]; the robot's or actuator's own when left out; a motor file has none.",
    "gear_ratio": "motor speed over joint speed; the robot's or actuator's own, or 1 for a motor file.",
    "gear_efficiency": "efficiency of the gear; the robot's or actuator's own, or 1 for a motor file.",
    "bus": "address of the robot: shm://NAME or unitree://NAME[@INTERFACE].",
    "top_speed": "commanded speed [m/s].",
    "distance": "length of a sprint [m].",
    "seed": "seed of the trials: joint noise, friction and payload follow from it.",
    "preset": "sprintlab, or paper: the paper's reward table to the letter.",
    "set": "a setting that differs from the default, e.g. ppo.steps=16.",
    "device": "cuda:0, cpu or auto.",
    "save_seconds": "time between checkpoints [s].",
    "drive": "motor model, battery, heat and air; the defaults are those of the published numbers.",
    "workers": "processes that work at the same time; one per core when left out.",
    "progress": "called with what is being done and the share done.",
}
"""Arguments that several functions take, and what they mean."""
