"""What a plan from the shell imports: nothing that it does not need, since importing takes longer than planning."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"torch", "sympy", "matplotlib", "pandas", "scipy.optimize", "PIL"}


@pytest.mark.parametrize("scenario", ["map_c", "parallel_in"])
def test_a_plan_without_pictures_imports_neither_torch_nor_matplotlib(scenario: str, tmp_path: Path) -> None:
    command = [sys.executable, "-X", "importtime", "-m", "drake_gnnocp.plan", scenario]
    done = subprocess.run(
        [*command, "--no-pictures", "--out", str(tmp_path)], capture_output=True, text=True, check=True
    )
    imported = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if line.startswith("import time:")}
    assert "drake_gnnocp.ocp.nlp" in imported and '"guess": "gnn"' in (tmp_path / "result.json").read_text("utf-8")
    assert not HEAVY & imported
