"""Files under artifacts/ as a notebook shows them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drake_gnnocp.experiments import artifacts
from drake_gnnocp.experiments.artifacts import WIDTH, Artifact

TABLES = """# Title

![a picture](there.png)

| a | b |
| --- | --- |
| 1 | 2 |

## Second

two

### Below it

deeper

## Third

three
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(artifacts, "artifacts_folder", lambda: tmp_path)
    return tmp_path


def test_a_missing_file_names_itself_and_the_command_that_makes_it(folder: Path) -> None:
    for name in ("table.md", "picture.png", "rows.csv"):
        missing = Artifact(name, "python -m make_it")
        for text in (missing._repr_markdown_(), repr(missing)):
            assert text is not None and f"artifacts/{name}" in text and "python -m make_it" in text
        assert missing._repr_png_() is None and missing.rows == []
    assert "python -m make_it" in (Artifact("table.md", "python -m make_it").section("Any")._repr_markdown_() or "")


def test_markdown_keeps_its_tables_and_loses_its_pictures(folder: Path) -> None:
    (folder / "table.md").write_text(TABLES)
    shown = Artifact("table.md", "")._repr_markdown_()
    assert shown == TABLES.replace("![a picture](there.png)\n\n", "")
    assert Artifact("table.md", "")._repr_png_() is None


def test_a_section_ends_where_the_next_of_its_rank_begins(folder: Path) -> None:
    (folder / "table.md").write_text(TABLES)
    table = Artifact("table.md", "")
    assert table.section("Second")._repr_markdown_() == "two\n\n### Below it\n\ndeeper"
    assert table.section("Below it")._repr_markdown_() == "deeper"
    assert table.section("Third")._repr_markdown_() == "three"
    assert "no section" in (table.section("Fourth")._repr_markdown_() or "")


def test_rows_of_a_table_go_by_their_columns(folder: Path) -> None:
    (folder / "rows.csv").write_text("map,seconds\nmap_a,0.3\n")
    assert Artifact("rows.csv", "").rows == [{"map": "map_a", "seconds": "0.3"}]


def test_a_picture_is_shown_smaller_and_with_few_colours(folder: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 2 * WIDTH, 3), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "picture.png")
    picture = Artifact("picture.png", "")
    assert picture._repr_markdown_() is None
    shown = picture._repr_png_()
    assert shown is not None
    with Image.open(io.BytesIO(shown)) as image:
        assert image.size == (WIDTH, 150) and image.mode == "P"
        assert len(image.getcolors() or []) < 256  # of the 16.7 million of noise


def test_artifacts_are_those_of_the_clone() -> None:
    assert (artifacts.artifacts_folder() / "weights" / "default.safetensors").exists()
