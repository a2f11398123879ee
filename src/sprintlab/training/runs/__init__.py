"""One training or many: rollouts and updates, checkpoints, progress, sweeps, export and figures."""
