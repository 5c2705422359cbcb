"""Planning: guess, optimal control and verification, joined by `plan`."""

from drake_gnnocp.planner.attempt import Attempt
from drake_gnnocp.planner.horizon import Fixed, FromGuess, Horizon, MinimumTime
from drake_gnnocp.planner.many import plan_many
from drake_gnnocp.planner.options import PlanOptions
from drake_gnnocp.planner.planner import plan
from drake_gnnocp.planner.result import Plan

__all__ = ["Attempt", "Fixed", "FromGuess", "Horizon", "MinimumTime", "Plan", "PlanOptions", "plan", "plan_many"]
