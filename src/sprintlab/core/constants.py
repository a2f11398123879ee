"""Constants of physics."""

GRAVITY = 9.81
"""Standard gravity, rounded as in the paper [m/s^2]."""
