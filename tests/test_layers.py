"""The house: imports go down only, the public face is complete, and no package hides behind a function's name."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import drake_gnnocp

PACKAGE = Path(drake_gnnocp.__file__).parent
CORE = {
    *("workers", "files", "budget", "drake_log", "vehicle", "polygons", "convex", "blocked", "shapes", "maps"),
    *("scenario_files", "scenario_arrays", "ends", "trajectory", "scenario"),
}
FLOORS = (  # from the ground up: a room imports from its own floor's rooms (see ASIDE) and from those below
    CORE,
    {"simulation", "verification", "search", "timing", "learning"},
    {"guesses", "ocp"},
    {"planner"},
    {"console", "arguments", "pictures", "exports", "batch", "command_line", "verify_command"},
    {"experiments"},
)
ASIDE = {  # imports within a floor, beside CORE's
    *{("timing", "search"), ("timing", "simulation"), ("ocp", "ocp"), ("command_line", "pictures")},
    *{("exports", "pictures"), ("command_line", "exports"), ("command_line", "batch")},
    *{("command_line", "console"), ("verify_command", "console"), ("command_line", "arguments")},
    *{("verify_command", "pictures"), ("verify_command", "arguments")},
}
FACES = {"__init__", "plan", "verify"}  # the public face and the commands see all
COMMANDS = {"dataset", "train", "benchmark", "ocp_benchmark", "stages", "figures", "tables", "analysis", "notebooks"}
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(path: Path) -> set[str]:
    """The rooms that a module imports when it is loaded, those for typing or inside of functions aside."""
    found = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("drake_gnnocp."):
            found.add(node.module.split(".")[1])
        if isinstance(node, ast.ImportFrom) and node.module == "drake_gnnocp":
            found.update(alias.name if alias.name in FLOOR else "__init__" for alias in node.names)
        if isinstance(node, ast.Import):
            found.update(alias.name.split(".")[1] for alias in node.names if alias.name.startswith("drake_gnnocp."))
    return found


def modules() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if room_of(path) not in FACES | COMMANDS]


def test_every_room_has_a_floor() -> None:
    assert {room_of(path) for path in modules()} == set(FLOOR)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down(path: Path) -> None:
    room = room_of(path)
    for other in imports_of(path) - {room}:
        is_beside = (room, other) in ASIDE or (room in CORE and other in CORE)
        assert other in FLOOR and (FLOOR[other] < FLOOR[room] or is_beside), f"{room} imports {other}"


def test_the_optimal_control_problem_and_its_check_share_no_code() -> None:
    for path in (PACKAGE / "verification").glob("*.py"):
        assert imports_of(path) <= CORE | {"verification"}


def test_nothing_heavy_is_loaded_by_the_face() -> None:
    code = "import sys, drake_gnnocp; print(*({'torch', 'matplotlib', 'pandas', 'casadi'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_all_public_names_are_there_and_described() -> None:
    for name in drake_gnnocp.__all__:
        assert getattr(drake_gnnocp, name).__doc__, name


def test_every_package_s_public_names_are_there() -> None:
    for found in pkgutil.walk_packages([str(PACKAGE)], "drake_gnnocp."):
        if found.ispkg:
            module = importlib.import_module(found.name)
            assert module.__doc__, found.name
            for name in getattr(module, "__all__", []):
                assert hasattr(module, name), f"{found.name}.{name}"
                assert not any(path.stem == name for path in Path(module.__file__ or "").parent.iterdir()), name


@pytest.mark.parametrize(("name", "package"), [("plan", "planner"), ("verify", "verification")])
def test_the_command_does_not_take_the_place_of_the_function(name: str, package: str) -> None:
    with pytest.raises(ImportError, match="a function and a command"):
        importlib.import_module(f"drake_gnnocp.{name}")
    assert callable(getattr(drake_gnnocp, name))
    assert getattr(importlib.import_module(f"drake_gnnocp.{package}"), name) is getattr(drake_gnnocp, name)


def test_the_planner_has_few_options() -> None:
    from dataclasses import fields, is_dataclass

    def leaves(options: object) -> int:
        values = [getattr(options, field.name) for field in fields(options)]  # type: ignore[arg-type]
        return sum(leaves(value) if is_dataclass(value) else 1 for value in values)

    assert leaves(drake_gnnocp.PlanOptions()) <= 25


@pytest.mark.parametrize("command", ["benchmark", "ocp_benchmark", "tables", "analysis"])
def test_a_command_that_reads_tables_says_what_it_needs(command: str) -> None:
    code = "import runpy, sys; sys.modules['pandas'] = None; "
    code += f"runpy.run_module('drake_gnnocp.{command}', None, '__main__')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "pandas is not installed: pip install -e .[experiments]\n")
