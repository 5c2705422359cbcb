"""What others read of a plan: tables of rows (CSV, JSON) for a reference point, messages of ROS 2 (MCAP), films."""

from drake_gnnocp.exports.choice import EXPORTS, Exports, add_exports
from drake_gnnocp.exports.ros import RosUnavailable, save_mcap
from drake_gnnocp.exports.tables import REFERENCES, centre_offset, save_centre_csv, save_json

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
