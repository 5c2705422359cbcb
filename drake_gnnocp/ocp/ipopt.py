"""Drake's Ipopt, set up for warm starts.

Measured on drake 1.51.1: `SPRAL` is the only linear solver there, the Hessian is always
limited-memory BFGS, and `warm_start_init_point` must stay off (it needs dual variables, which Drake does not pass).
"""

from __future__ import annotations

import re
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import NoReturn

import numpy as np
from pydrake.solvers import IpoptSolver, MathematicalProgram, SolverOptions

from drake_gnnocp.drake_log import drake_lines

HUGE = 1e20
OUT_OF_TIME = "Wall time exceeded"  # status, in Ipopt's words
SHORTEST_TIME, LONGEST_TIME = 1e-3, 1e6  # s, what Ipopt takes for a limit


@dataclass(frozen=True)
class IpoptSettings:
    """The options that matter for this problem; the rest keep Ipopt's defaults."""

    mu_init: float = 1e-4  # barrier of a start near the optimum: it does not push the guess off its constraints
    bound_multiplier: float = 1.0  # first one of all bounds; with the barrier it says how far they push at first
    push: float = 1e-6  # relative, how far the start is moved inside its bounds
    feasibility: float = 1e-5  # m (and rad), largest constraint violation accepted
    complementarity: float = 1e-2  # largest complementarity accepted
    objective_change: float = 1e-3  # relative, of the last iterations: stop when the cost has settled
    settled_iterations: int = 2  # iterations the above must hold
    max_iterations: int = 200
    history: int = 6  # pairs of the limited-memory BFGS


USUAL = IpoptSettings()
# where SQP steps have converged: they have done the optimising, and a barrier of 1e-4 leads away from there; of 80
# finishes of hard tasks none took more than 24 iterations, but for those that did not end in 200. The constraints hold
# after one or two. Multipliers of bounds that are not active take several more to vanish: to wait for them would gain
# 0.04 % of the cost for 2.2 iterations (80 tasks)
FINISH = IpoptSettings(
    objective_change=2e-4,
    settled_iterations=1,
    complementarity=HUGE,
    mu_init=3e-5,
    bound_multiplier=3.0,
    max_iterations=50,
)


@dataclass(frozen=True)
class Solution:
    """What Ipopt returned."""

    program_values: np.ndarray  # values of all decision variables
    success: bool  # Ipopt's word for it; never a plan's
    status: str
    iterations: int
    seconds: float  # s
    violated: tuple[str, ...]  # descriptions of the constraints that do not hold


def solve(
    program: MathematicalProgram, guess: np.ndarray, hessian: float, max_seconds: float, settings: IpoptSettings
) -> Solution:
    """Solve a program from a guess.

    Args:
        program: to solve.
        guess: values of all decision variables.
        hessian: the first BFGS matrix is this times the identity.
        max_seconds: wall-clock limit [s].
        settings: see `IpoptSettings`.
    """
    solver = IpoptSolver()
    with tempfile.TemporaryDirectory(prefix="ipopt") as folder:
        log = Path(folder) / "log"
        options = SolverOptions()
        for name, value in _options(hessian, min(max(max_seconds, SHORTEST_TIME), LONGEST_TIME), settings, log).items():
            options.SetOption(solver.solver_id(), name, value)
        start = time.perf_counter()
        with drake_lines(), _interruptible():
            result = solver.Solve(program, guess, options)
        seconds = time.perf_counter() - start
        iterations = _iterations(log)
    violated = () if result.is_success() else tuple(result.GetInfeasibleConstraintNames(program))
    status = result.get_solver_details().ConvertStatusToString()
    return Solution(result.get_x_val(), result.is_success(), status, iterations, seconds, violated)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C is raised again after a solve: in a callback it ends the solve, but Ipopt keeps it to itself."""
    pressed: list[int] = []

    def note(number: int, _: FrameType | None) -> NoReturn:
        pressed.append(number)
        raise KeyboardInterrupt

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not usual or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if pressed:
        raise KeyboardInterrupt


def _options(hessian: float, max_seconds: float, settings: IpoptSettings, log: Path) -> dict[str, float | int | str]:
    return {
        "limited_memory_initialization": "constant",
        "limited_memory_init_val": hessian,
        "limited_memory_max_history": settings.history,
        # multipliers to begin with would take a factorisation, and from zero it takes the same iterations
        "constr_mult_init_max": 0.0,
        # the default ordering and scaling made the linear algebra 3.5 times slower: the scaling forces a new
        # analysis of the matrix in every iteration
        "spral_order": "metis",
        "spral_scaling": "none",
        "spral_nemin": 8,
        "mu_strategy": "monotone",
        "mu_init": settings.mu_init,
        "bound_mult_init_val": settings.bound_multiplier,
        "bound_push": settings.push,
        "bound_frac": settings.push,
        "slack_bound_push": settings.push,
        "slack_bound_frac": settings.push,
        # stop by progress: the scale of the states inflates the dual infeasibility
        "acceptable_tol": HUGE,
        "acceptable_dual_inf_tol": HUGE,
        "acceptable_constr_viol_tol": settings.feasibility,
        "acceptable_compl_inf_tol": settings.complementarity,
        "acceptable_obj_change_tol": settings.objective_change,
        "acceptable_iter": settings.settled_iterations,
        "max_iter": settings.max_iterations,
        "max_wall_time": max_seconds,
        "output_file": str(log),
        "file_print_level": 3,
        "print_level": 0,
        "sb": "yes",
    }


def _iterations(log: Path) -> int:
    found = re.search(r"Number of Iterations\.*: *(\d+)", log.read_text()) if log.exists() else None
    return int(found.group(1)) if found else 0
