"""Files under `artifacts/` that show themselves in a notebook: tables as tables, pictures as pictures.

What is not there yet says so, with the command that makes it: a notebook of results never fails for want of one.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from drake_gnnocp.pictures.style import small_picture

FOLDER = "artifacts"
WIDTH = 1000  # pixels, of pictures in a notebook


def artifacts_folder() -> Path:
    """The folder `artifacts/` of the clone that the package is in, from wherever a notebook is run."""
    return Path(__file__).resolve().parents[2] / FOLDER


@dataclass(frozen=True)
class Artifact:
    """A file by its name under `artifacts/`; Jupyter shows what is in it.

    Markdown keeps its tables and loses its pictures, whose links lead elsewhere from a notebook.
    """

    name: str
    command: str  # that makes it

    @property
    def path(self) -> Path:
        """Where it is or would be."""
        return artifacts_folder() / self.name

    @property
    def rows(self) -> list[dict[str, str]]:
        """The rows of a CSV file by their columns; none where it is missing."""
        if not self.path.exists():
            return []
        with self.path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def section(self, heading: str) -> Section:
        """One section of a Markdown file, by its heading."""
        return Section(self.name, self.command, heading)

    def __repr__(self) -> str:
        return f"artifacts/{self.name}" if self.path.exists() else self._missing

    def _repr_markdown_(self) -> str | None:
        if not self.path.exists():
            return self._missing
        if self.path.suffix != ".md":
            return None
        return re.sub(r"!\[[^\]]*\]\([^)]*\)\n*", "", self.path.read_text(encoding="utf-8"))

    def _repr_png_(self) -> bytes | None:
        if self.path.suffix != ".png" or not self.path.exists():
            return None
        return small_picture(self.path, WIDTH)

    @property
    def _missing(self) -> str:
        return f"*`artifacts/{self.name}` is not there yet; it is made by* `{self.command}`"


@dataclass(frozen=True, repr=False)
class Section(Artifact):
    """One section of a Markdown file: from its heading to the next of the same rank."""

    heading: str

    def _repr_markdown_(self) -> str | None:
        text = super()._repr_markdown_() or ""
        found = re.search(rf"^(#+) {re.escape(self.heading)}$.*?(?=^\1 |^#{{1,2}} |\Z)", text, re.MULTILINE | re.DOTALL)
        if found is None:
            return text if not self.path.exists() else f"*no section* {self.heading} *in* `artifacts/{self.name}`"
        return found.group(0).split("\n", 1)[1].strip()
