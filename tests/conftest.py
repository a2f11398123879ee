"""Settings that every test shares."""

from hypothesis import HealthCheck, settings

# No deadline: machines that run tests are shared, and the first call imports libraries.
settings.register_profile(
    "sprintlab", deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("sprintlab")
