"""The command line `python -m drake_gnnocp.verify SCENARIO TRAJECTORY.csv`: the check, for anyone's trajectory."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from drake_gnnocp.arguments import TASK, add_task_arguments, with_signed_numbers
from drake_gnnocp.console import DONE, NOT_VERIFIED, OneLineParser, failed
from drake_gnnocp.ends import nearest_target
from drake_gnnocp.files import replaced_together, write_atomically
from drake_gnnocp.pictures import save_plan_picture
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import drive
from drake_gnnocp.trajectory import COLUMNS, Trajectory
from drake_gnnocp.verification import Verification, verify

PICTURE, DATA = "verification.png", "verification.json"
LABELS = ("path of the table", "driven path")
HEADINGS = ("checked", "allowed", "found", "where", "when", "ok")


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.verify",
        description="Drive the inputs of a trajectory from the scenario's start, and check all that a plan promises.",
        epilog="Exit code: 0 verified, 2 bad input, 3 not verified, 4 the output could not be written.",
    )
    parser.add_argument(
        "scenario",
        help="a bundled name, a .json or a TPCAP .csv file, or the .yaml file of an occupancy map, which needs --start "
        "and --goal",
    )
    add_task_arguments(parser)
    columns = ",".join(COLUMNS)
    parser.add_argument("trajectory", type=Path, help=f"a .csv file with the header {columns}; knots of any spacing")
    parser.add_argument("--out", type=Path, metavar="DIR", help=f"folder to write {PICTURE} and {DATA} into")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, verify, print a table of findings and write the files; returns the exit code."""
    arguments = _parser().parse_args(with_signed_numbers(sys.argv[1:] if argv is None else argv))
    try:
        scenario = Scenario.load(arguments.scenario, **{key: getattr(arguments, key) for key in TASK})
        trajectory = Trajectory.load_csv(arguments.trajectory)
        if trajectory.flaw:
            raise ValueError(f"{arguments.trajectory}: {trajectory.flaw}")
        x0, y0, _ = scenario.start  # near the origin, see Scenario.translated
        found = verify(scenario.translated(-x0, -y0), trajectory.translated(-x0, -y0)).translated(x0, y0)
        print("\n".join(_table(found)))
        print(f"{scenario.name}: {_outcome(found)}{_reached(scenario, trajectory) if found.verified else ''}")
    except ValueError as error:
        return failed(error, arguments.trajectory)
    if arguments.out is not None:
        try:
            with replaced_together(arguments.out, (PICTURE, DATA)) as stage:
                _save(stage, scenario, trajectory, found)
        except OSError as error:
            return failed(error, arguments.out)
        print(f"written to {arguments.out}")
    return DONE if found.verified else NOT_VERIFIED


def _outcome(found: Verification) -> str:
    if found.verified:
        return f"verified, {found.clearance_text}"
    if not found.findings:
        return "not verified: its inputs are too large, or it takes too long, to be driven"
    return f"not verified: {'; '.join(found.faults)}"


def _reached(scenario: Scenario, trajectory: Trajectory) -> str:
    """Which of several goals a verified trajectory ends at."""
    if len(scenario.goals) < 2:
        return ""
    return f", reaches {scenario.name_of_goal(nearest_target(scenario.targets, trajectory.poses[-1]))}"


def _table(found: Verification) -> list[str]:
    """The findings in columns, a line each."""
    rows = [HEADINGS] + [
        (
            finding.what,
            finding.allowed,
            finding.found,
            f"({finding.x:.2f}, {finding.y:.2f})",
            f"{finding.t:.2f} s",
            "yes" if finding.ok else "NO",
        )
        for finding in found.findings
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _driven(scenario: Scenario, trajectory: Trajectory) -> Trajectory:
    """What the car does when it is driven by the inputs, at rows as close as they were driven."""
    motion = drive(scenario.start, trajectory, scenario.vehicle)
    inputs = [np.interp(motion.t, trajectory.t, column) for column in trajectory.inputs.T]
    return Trajectory(motion.t, motion.states, np.stack(inputs, axis=1))


def _save(folder: Path, scenario: Scenario, trajectory: Trajectory, found: Verification) -> None:
    """Write the data and a picture of what was checked: the path that is driven, and that of the table beside it."""
    title = f"{scenario.name}: {'verified' if found.verified else 'unverified'}"
    driven = _driven(scenario, trajectory) if found.findings else None
    save_plan_picture(folder / PICTURE, scenario, driven, trajectory, title, found.first_fault, labels=LABELS)
    data = {
        "scenario": scenario.name,
        "verified": found.verified,
        "verification": found.to_dict(),
        "findings": [asdict(finding) for finding in found.findings],
    }
    write_atomically(folder / DATA, json.dumps(data, indent=1, allow_nan=False) + "\n")
