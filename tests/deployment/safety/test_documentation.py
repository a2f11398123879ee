"""The table that users read is the one that the controller follows."""

from __future__ import annotations

from pathlib import Path

import pytest

from sprintlab.deployment.safety import RESPONSES

DOCUMENT = Path(__file__).parents[3] / "docs" / "deployment.md"


@pytest.mark.skipif(not DOCUMENT.is_file(), reason="the documents are not part of an installed package")
def test_the_document_lists_every_response_as_it_is():
    text = DOCUMENT.read_text(encoding="utf-8")
    for fault, response in RESPONSES.items():
        time = f"{1e3 * response.within:g} ms"
        assert f"| `{fault.value}` | {response.meaning} | {response.reaction.value} | {time} |" in text
    assert text.count("\n| `") >= len(RESPONSES)
