"""Trajectory planning in unstructured places: a guess, optimal control with Drake, and independent verification."""

from drake_gnnocp.ends import GoalTolerance
from drake_gnnocp.guesses import (
    Given,
    Guess,
    GuessSource,
    GuessUnavailable,
    HybridAStar,
    Learned,
    NoGuess,
    RrtStar,
    Straight,
)
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.planner import Attempt, Fixed, FromGuess, MinimumTime, Plan, PlanOptions, plan, plan_many
from drake_gnnocp.scenario import Area, Scenario, ScenarioError, bundled_scenarios
from drake_gnnocp.search.stages import HybridAStarOptions
from drake_gnnocp.timing.at_rate import at_rate
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle
from drake_gnnocp.verification import Verification, verify

__version__ = "0.1.0"

__all__ = [
    "Area",
    "Attempt",
    "CostWeights",
    "Fixed",
    "FromGuess",
    "Given",
    "GoalTolerance",
    "Guess",
    "GuessSource",
    "GuessUnavailable",
    "HybridAStar",
    "HybridAStarOptions",
    "Learned",
    "MinimumTime",
    "NoGuess",
    "Plan",
    "PlanOptions",
    "RrtStar",
    "Scenario",
    "ScenarioError",
    "Straight",
    "Trajectory",
    "Vehicle",
    "Verification",
    "at_rate",
    "bundled_scenarios",
    "plan",
    "plan_many",
    "verify",
]
