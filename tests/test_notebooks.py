"""The notebooks: they run, and what is committed of them is what they gave."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest

from drake_gnnocp.experiments.notebooks import CLONE, STAMP, fingerprint, main, notebooks, read

NAMES = ["01_quickstart", "02_your_own_scenario", "03_inside_the_ocp", "04_train_the_gnn", "05_the_paper"]
QUICK = ("05_the_paper",)  # the others take 8 CPU seconds and more
LARGEST = 1.5e6  # bytes, of a committed notebook
AGAIN = "run python -m drake_gnnocp.notebooks"

every_notebook = pytest.mark.parametrize("path", [pytest.param(path, id=path.stem) for path in notebooks()])


def run(path: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Execute a notebook as users do; its sockets are those of another process."""
    command = [sys.executable, "-m", "drake_gnnocp.notebooks", str(path), *options]
    return subprocess.run(
        command, cwd=path.parent, env=os.environ | {"PYTHONPATH": str(CLONE)}, capture_output=True, text=True
    )


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def kinds(notebook: Any) -> list[list[Any]]:
    """What is put out by every code cell: streams by their names, other outputs by their MIME types."""
    return [
        [output.get("name") or sorted(output.get("data", {})) for output in cell.outputs]
        for cell in code_cells(notebook)
    ]


def shows_something(source: str) -> bool:
    """Whether a cell prints, or ends in an expression."""
    lines = [line for line in source.splitlines() if not line.startswith("%")]
    tree = ast.parse("\n".join(lines))
    prints = any(isinstance(node, ast.Name) and node.id in ("print", "display") for node in ast.walk(tree))
    return prints or isinstance(tree.body[-1], ast.Expr)


def test_all_five_are_there() -> None:
    assert [path.stem for path in notebooks()] == NAMES


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, id=p.stem, marks=() if p.stem in QUICK else pytest.mark.slow) for p in notebooks()],
)
def test_it_runs_and_gives_the_kinds_of_outputs_that_are_committed(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "notebooks"  # it may write beside itself
    folder.mkdir()
    copy = Path(shutil.copy(path, folder))
    done = run(copy)
    assert done.returncode == 0, done.stderr
    assert kinds(read(copy)) == kinds(read(path)), f"{path.name}: other outputs than the committed ones; {AGAIN}"


@every_notebook
def test_the_committed_outputs_are_of_the_committed_code(path: Path) -> None:
    notebook = read(path)
    assert notebook.metadata.get(STAMP) == fingerprint(notebook), f"{path.name}: stale outputs; {AGAIN}"
    assert [cell.execution_count for cell in code_cells(notebook)] == list(range(1, len(code_cells(notebook)) + 1))


@every_notebook
def test_every_cell_that_shows_something_has_outputs_and_none_is_an_error_or_a_warning(path: Path) -> None:
    for cell in code_cells(read(path)):
        assert bool(cell.outputs) or not shows_something(cell.source), cell.source
        for output in cell.outputs:
            assert output.output_type != "error" and output.get("name") != "stderr", cell.source


@every_notebook
def test_it_is_small_and_says_first_what_one_will_see(path: Path) -> None:
    assert path.stat().st_size < LARGEST
    notebook = read(path)
    assert notebook.cells[0].cell_type == "markdown" and notebook.cells[0].source.startswith("# ")
    assert str(Path.home()) not in path.read_text(encoding="utf-8") and "/work/" not in path.read_text(encoding="utf-8")


# --- executing ---


def written(path: Path, *sources: str) -> Path:
    cells = [nbformat.v4.new_code_cell(source) for source in sources]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    return path


def test_a_notebook_is_executed_in_place_by_this_copy_of_the_package(tmp_path: Path) -> None:
    path = written(tmp_path / "a.ipynb", "import drake_gnnocp, os", "print(drake_gnnocp.__file__)\nprint(os.getcwd())")
    done = run(path)
    assert done.returncode == 0 and "a.ipynb" in done.stdout, done.stderr
    found = read(path)
    assert found.cells[1].outputs[0].text == f"{CLONE / 'drake_gnnocp' / '__init__.py'}\n{tmp_path}\n"
    assert found.metadata[STAMP] == fingerprint(found)


@pytest.mark.parametrize(
    ("source", "options", "told"),
    [
        ("1 / 0", (), "ZeroDivisionError"),
        ("import threading; threading.Event().wait()", ("--max-seconds", "1"), "timed out"),
    ],
)
def test_a_notebook_whose_cell_fails_or_takes_too_long_is_left_as_it_was(
    source: str, options: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "a.ipynb", "print(1)", source)
    before = path.read_bytes()
    done = run(path, *options)
    assert done.returncode == 3 and path.read_bytes() == before
    assert "a.ipynb" in done.stderr and told in done.stderr


@pytest.mark.parametrize(("name", "content"), [("missing.ipynb", None), ("text.ipynb", "not a notebook")])
def test_what_is_no_notebook_is_refused_in_one_line(
    name: str, content: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    assert main([str(path)]) == 2
    message = capsys.readouterr().err
    assert name in message and message.count("\n") == 1


def test_the_fingerprint_changes_with_the_code_and_not_with_the_text(tmp_path: Path) -> None:
    one, other = (read(written(tmp_path / "a.ipynb", source)) for source in ("print(1)", "print(2)"))
    assert fingerprint(one) != fingerprint(other)
    before = fingerprint(one)
    one.cells.append(nbformat.v4.new_markdown_cell("text"))
    assert fingerprint(one) == before
