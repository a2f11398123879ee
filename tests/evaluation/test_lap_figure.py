"""The picture of a lap: the path lies on the lane that is drawn."""

import numpy as np
import pytest

from sprintlab.commands import Track
from sprintlab.evaluation.lap_figure import _oval


@pytest.mark.parametrize("outward", [-0.3, 0.0, 0.92])
def test_every_point_of_the_oval_has_the_offset_that_it_is_drawn_for(outward):
    track = Track()
    offsets = [track.locate(x, y).offset for x, y in _oval(track, outward)]
    assert np.allclose(offsets, -outward, atol=1e-9)
