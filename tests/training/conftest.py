"""Tests of training need PyTorch, but for those that plan."""

from importlib.util import find_spec
from pathlib import Path

WITHOUT_TORCH = ("test_scaling.py", "test_sweep.py")
collect_ignore = [
    path.name
    for path in Path(__file__).parent.glob("test_*.py")
    if find_spec("torch") is None and path.name not in WITHOUT_TORCH
]
