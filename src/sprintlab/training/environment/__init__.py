"""The training world: physics, motors, rewards and randomization of all robots on the device."""
