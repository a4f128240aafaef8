"""The README as a page of an index of packages, where links and pictures of the repository lead nowhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class ReadmeHook(MetadataHookInterface):
    """Hatchling's: asked for the metadata of a wheel or sdist as it is built."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the README, its links to files those of the version that is built."""
        repository, version = metadata["urls"]["Repository"], metadata["version"]
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        at = "main" if ".dev" in version or version == "0.0" else f"v{version}"
        metadata["readme"] = {"content-type": "text/markdown", "text": absolute(text, repository, at)}


def absolute(text: str, repository: str, at: str) -> str:
    """A Markdown text with the addresses of its links to files, and of its pictures.

    Parameters
    ----------
    text
        With links relative to the root of the repository.
    repository
        Its address.
    at
        A branch or tag.
    """

    def address(match: re.Match[str]) -> str:
        kind = "raw" if match[1].endswith((".gif", ".jpg", ".png", ".svg")) else "blob"
        return f"]({repository}/{kind}/{at}/{match[1]})"

    return re.sub(r"\]\((?![a-z]+:|#)([^)]+)\)", address, text)
