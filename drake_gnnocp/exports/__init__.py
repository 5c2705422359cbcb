"""What others read of a plan: tables of rows (CSV, JSON) for a reference point, messages of ROS 2 (MCAP), films."""

from typing import TYPE_CHECKING, Any

from drake_gnnocp.exports.choice import EXPORTS, Exports, add_exports
from drake_gnnocp.exports.tables import REFERENCES, centre_offset, save_centre_csv, save_json

if TYPE_CHECKING:
    from drake_gnnocp.exports.ros import RosUnavailable, save_mcap

__all__ = [
    "EXPORTS",
    "REFERENCES",
    "Exports",
    "RosUnavailable",
    "add_exports",
    "centre_offset",
    "save_centre_csv",
    "save_json",
    "save_mcap",
]


def __getattr__(name: str) -> Any:
    """What is for ROS has its colours from pictures, and these take long to import."""
    if name not in ("RosUnavailable", "save_mcap"):
        raise AttributeError(name)
    from drake_gnnocp.exports import ros

    return getattr(ros, name)
