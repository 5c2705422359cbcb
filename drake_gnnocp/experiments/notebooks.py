"""Execute the notebooks afresh, outputs and all: `python -m drake_gnnocp.notebooks [FILE...]`."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drake_gnnocp.console import BAD_INPUT, DONE, OneLineParser, seconds
from drake_gnnocp.files import write_atomically

if TYPE_CHECKING:
    from nbformat import NotebookNode

FAILED = 3  # exit code, beside those of all commands
START_SECONDS = 300  # s, for a kernel to answer: on a busy machine it takes a minute
STAMP = "executed"  # key of a notebook's metadata: the `fingerprint` of the code that its outputs are of
CLONE = Path(__file__).resolve().parents[2]  # or site-packages, where the package is installed without its notebooks


class NotebookError(ValueError):
    """A notebook cannot be read, or a cell of it raised; the message names it."""


def notebooks() -> list[Path]:
    """The project's notebooks, in their order."""
    return sorted((CLONE / "notebooks").glob("*.ipynb"))


def read(path: Path) -> NotebookNode:
    """A notebook from a file.

    Raises:
        NotebookError: it cannot be read, or is something else.
    """
    import nbformat

    try:
        return nbformat.read(path, as_version=4)
    except OSError as error:
        raise NotebookError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise NotebookError(f"{path}: not a notebook: {str(error).splitlines()[0]:.200}") from None


def fingerprint(notebook: NotebookNode) -> str:
    """What tells the code of a notebook from any other; text between the cells does not count."""
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(code).encode()).hexdigest()


def execute(path: Path, max_seconds: float) -> NotebookNode:
    """Run a notebook's cells from the first to the last, in its folder.

    The kernel is this interpreter with this copy of the package, whatever kernels Jupyter knows.

    Args:
        path: of the notebook, which is not changed.
        max_seconds: longest that a cell may take [s].

    Returns:
        The notebook with its outputs.

    Raises:
        NotebookError: it cannot be read, or a cell raised or took longer.
    """
    from jupyter_client.kernelspec import KernelSpecManager
    from jupyter_client.manager import AsyncKernelManager
    from nbclient import NotebookClient
    from nbclient.exceptions import CellControlSignal

    notebook = read(path)
    kernel = AsyncKernelManager(kernel_name="python3", kernel_spec_manager=KernelSpecManager(kernel_dirs=[]))
    client = NotebookClient(
        notebook,
        km=kernel,
        extra_arguments=["--log-level=ERROR"],  # it warns of every kernel that talks over TCP
        timeout=max_seconds,
        startup_timeout=START_SECONDS,
        coalesce_streams=True,
        record_timing=False,  # the same outputs are the same file
        resources={"metadata": {"path": str(path.parent)}},
    )
    imports = os.pathsep.join(filter(None, (str(CLONE), os.environ.get("PYTHONPATH"))))
    no_bars = {"TQDM_DISABLE": "1"}  # of progress: they are for who looks on
    try:
        client.execute(env=os.environ | {"PYTHONPATH": imports} | no_bars)
    except (CellControlSignal, RuntimeError) as error:  # the latter: no answer from the kernel
        raise NotebookError(f"{path}: {error}") from None
    notebook.metadata["language_info"] = {"name": "python"}  # not the version, which differs between machines
    notebook.metadata[STAMP] = fingerprint(notebook)
    return notebook


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.notebooks",
        description="Execute notebooks from the first cell to the last and keep the outputs in them. "
        "To open them: python -m jupyter lab notebooks",
        epilog="Exit code: 0 done; 2 bad input; 3 a cell failed: its notebook is left as it was.",
    )
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="notebooks (default: all in notebooks/)")
    parser.add_argument(
        "--max-seconds",
        type=seconds,
        default=300.0,
        metavar="S",
        help="longest that a cell may take in seconds (default: %(default)g)",
    )
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, execute and write; returns the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        import nbformat
    except ModuleNotFoundError:
        print("notebooks need Jupyter: pip install -e .[notebooks]", file=sys.stderr)
        return BAD_INPUT
    for path in arguments.files or notebooks():
        begin = time.monotonic()
        try:
            read(path)
        except NotebookError as error:
            print(error, file=sys.stderr)
            return BAD_INPUT
        try:
            executed = execute(path, arguments.max_seconds)
        except NotebookError as error:
            print(error, file=sys.stderr)
            return FAILED
        write_atomically(path, nbformat.writes(executed) + "\n")
        print(f"{path.name}: {time.monotonic() - begin:.0f} s, {path.stat().st_size / 1e3:.0f} kB")
    return DONE
