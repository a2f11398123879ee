"""The address of the repository in the package's metadata: the variable ``SPRINTLAB_URL`` fills it."""

import os
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class Address(MetadataHookInterface):
    """Adds the project's URLs where the address is known."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill ``urls``; without an address there are none."""
        address = os.environ.get("SPRINTLAB_URL", "").rstrip("/")
        parts = {"Repository": "", "Changelog": "/blob/main/CHANGELOG.md", "Issues": "/issues"}
        metadata["urls"] = {name: address + path for name, path in parts.items()} if address else {}
