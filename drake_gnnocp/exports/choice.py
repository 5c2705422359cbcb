"""Which files of a plan are written beside those that always are, how and with which rows.

What draws is imported where something is drawn: matplotlib takes longer to import than many a plan to be made.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from drake_gnnocp.exports.tables import CENTRE, REAR_AXLE, REFERENCES, save_centre_csv, save_json
from drake_gnnocp.planner.result import Plan

FORMATS = {"csv": "trajectory.csv", "json": "trajectory.json", "mcap": "plan.mcap"}  # and their files
GIF, MP4 = "plan.gif", "plan.mp4"
EXPORTS = ("trajectory.json", "plan.mcap", GIF, MP4)  # files beside those of every plan
HIGHEST_RATE = 1000.0  # Hz


@dataclass(frozen=True)
class Exports:
    """What a user asks for."""

    rate: float | None = None  # Hz, rows of the trajectory; None: the planner's knots
    reference: str = REAR_AXLE  # what x and y of tables are those of
    formats: tuple[str, ...] = ("csv",)  # of FORMATS
    gif: bool = False
    mp4: bool = False

    def check(self) -> None:
        """See that all of it can be made.

        Raises:
            ValueError: something is not installed; the message names it.
        """
        if "mcap" in self.formats:
            from drake_gnnocp.exports.ros import check_available

            check_available()
        if self.mp4:
            from drake_gnnocp.pictures.animation import check_mp4

            check_mp4()

    def resampled(self, plan: Plan) -> tuple[Plan, str]:
        """The plan with the rows that are asked for.

        Returns:
            The plan to write, and why it is the plan as it was, though rows at a rate were asked for; empty if not so.
        """
        if self.rate is None or plan.trajectory is None:
            return plan, ""
        if not plan.verified:
            return plan, f"--rate: the plan is not verified; it is written with its own {len(plan.trajectory)} knots"
        try:
            made = plan.resampled(self.rate)
            reason = made.reason
        except ValueError as error:
            made, reason = plan, str(error)
        if not reason:
            return made, ""
        knots = f"the plan is written with its own {len(plan.trajectory)} knots"
        return plan, f"--rate: rows at {self.rate:g} Hz are not verified ({reason}); {knots}"

    def save(self, plan: Plan, folder: Path) -> None:
        """Write the files into a folder in which the plan has been saved.

        Raises:
            OSError: one could not be written.
        """
        trajectory = plan.trajectory
        if trajectory is None:
            return
        scenario, table = plan.scenario, folder / FORMATS["csv"]
        if "csv" not in self.formats:
            table.unlink()
        elif self.reference == CENTRE:
            save_centre_csv(table, trajectory, scenario.vehicle)
        if "json" in self.formats:
            save_json(folder / FORMATS["json"], scenario, trajectory, plan.status, self.reference)
        if "mcap" in self.formats:
            from drake_gnnocp.exports.ros import save_mcap

            save_mcap(folder / FORMATS["mcap"], scenario, trajectory)
        if self.gif or self.mp4:
            from drake_gnnocp.pictures.animation import save_gif, save_mp4

            films = [(GIF, save_gif)] * self.gif + [(MP4, save_mp4)] * self.mp4
            for name, save_film in films:
                save_film(folder / name, scenario, trajectory, f"{scenario.name}: {plan.status}", plan.first_fault)


def add_exports(parser: argparse.ArgumentParser) -> None:
    """Add the options of `Exports` to those of a command."""
    add = parser.add_argument
    rate = "rows of the trajectory a second, verified as they are written; the plan is slowed down by less than one row"
    add("--rate", type=_rate, metavar="HZ", help=f"{rate} (default: the planner's knots)")
    reference = "what x and y in the tables are those of; the centre's columns are x_centre,y_centre"
    add("--reference", choices=REFERENCES, default=REAR_AXLE, help=f"{reference} (default: %(default)s)")
    formats = f"{', '.join(FORMATS)}, or several with commas: files of the trajectory; mcap is for ROS 2 and Foxglove"
    add("--format", type=_formats, default=("csv",), metavar="NAMES", help=f"{formats} (default: csv)")
    add("--gif", action="store_true", help=f"write {GIF}: the car drives the plan, at most 10 s")
    add("--mp4", action="store_true", help=f"write {MP4}, by ffmpeg")


def _rate(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value <= HIGHEST_RATE:
        raise argparse.ArgumentTypeError(f"must be above 0 and at most {HIGHEST_RATE:g} Hz, not {text!r}")
    return value


def _formats(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in FORMATS:
            raise argparse.ArgumentTypeError(f"must be of {', '.join(FORMATS)}, not {name!r}")
    return names
