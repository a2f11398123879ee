"""Delay, jitter and loss of a simulated link."""

from hypothesis import given
from hypothesis import strategies as st

from sprintlab.deployment.simulator import Link, LinkOptions

STEP = 0.001


def send(options, count=500, seed=0):
    """Send one message a step; the step at which each one arrived."""
    link, arrived = Link(options, seed), {}
    for step in range(count + 2500):
        if step < count:
            link.push(step * STEP, step)
        for item in link.pop(step * STEP):
            arrived[item] = step
    return arrived


@given(delay=st.floats(0.0, 0.05), jitter=st.floats(0.0, 0.05), seed=st.integers(0, 100))
def test_messages_never_overtake_and_are_neither_early_nor_later_than_the_jitter_allows(delay, jitter, seed):
    arrived = send(LinkOptions(delay=delay, jitter=jitter), count=200, seed=seed)
    steps = [arrived[item] for item in range(200)]
    assert steps == sorted(steps)
    for item, step in arrived.items():
        late = (step - item) * STEP
        assert delay - 1e-5 <= late <= delay + jitter + STEP + 1e-5


def test_the_lost_share_is_as_asked_and_the_seed_decides_which():
    options = LinkOptions(loss=0.2, jitter=0.01)
    arrived = send(options, count=5000)
    assert 0.77 < len(arrived) / 5000 < 0.83
    assert arrived == send(options, count=5000) != send(options, count=5000, seed=5)
