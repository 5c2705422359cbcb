"""Trajectory planning in unstructured places: a guess, optimal control with Drake, and independent verification."""

from drake_gnnocp.planner import Plan, plan
from drake_gnnocp.scenario import Scenario, ScenarioError
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

__all__ = ["Plan", "Scenario", "ScenarioError", "Trajectory", "Vehicle", "plan"]
