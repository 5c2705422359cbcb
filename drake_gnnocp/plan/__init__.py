"""Planning: `plan` joins guess, optimal control and verification; `python -m drake_gnnocp.plan` is its command line."""

from drake_gnnocp.plan.planner import PlanOptions, plan
from drake_gnnocp.plan.result import Attempt, Plan

__all__ = ["Attempt", "Plan", "PlanOptions", "plan"]
