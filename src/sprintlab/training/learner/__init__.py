"""PPO with the VAE estimator: networks, losses, rollout storage and the update."""
