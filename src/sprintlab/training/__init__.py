"""Training on the GPU: environment, rewards, randomization, PPO, export. Needs the extra ``train``."""
