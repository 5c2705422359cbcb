"""Planning: `plan` joins guess, optimal control and verification; `python -m drake_gnnocp.plan` is its command line."""

from drake_gnnocp.planner.planner import PlanOptions, plan
from drake_gnnocp.planner.result import Attempt, Plan

__all__ = ["Attempt", "Plan", "PlanOptions", "plan"]
