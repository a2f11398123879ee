"""ONNX Runtime, kept quiet: on Linux it reports what it runs to its maker, as soon as it is imported.

For that it reads and writes ``.ses`` in the folder of temporary files, where anybody may have put a pipe, at
which it would wait for ever, or a link to a file, which it would overwrite. To have it all the same, set
``ORT_DISABLE_TELEMETRY=0``.
"""

from __future__ import annotations

import os
from typing import Any

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # it is read once, by the import

import onnxruntime as _onnxruntime  # pyright: ignore[reportMissingTypeStubs]

onnxruntime: Any = _onnxruntime
