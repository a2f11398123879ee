"""The helpers of control and commands choose the library of what they are given."""

import array_api_compat
import numpy as np
import pytest

from sprintlab.control.arrays import clip, filled, namespace


def test_a_tensor_decides(torch):
    tensor = torch.zeros(2)
    assert namespace(1.0, tensor) is array_api_compat.array_namespace(tensor)
    assert clip(tensor + 5.0, -1.0, 2.0).tolist() == [2.0, 2.0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_a_scalar_takes_the_type_of_what_it_meets(dtype, shape):
    like = np.full(shape, 0.1, dtype)
    assert filled(0.3, like).dtype == dtype
    assert filled(0.3, like) == np.full_like(like, 0.3).ravel()[0]
    limited = clip(like, 0.3, 1.0)
    assert limited.dtype == dtype and limited.shape == shape
    np.testing.assert_array_equal(limited, np.full(shape, 0.3, dtype))
    assert np.isnan(clip(np.full(shape, np.nan, dtype), 0.3, 1.0)).all()
