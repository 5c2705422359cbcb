"""The ranking of a network's hypotheses, fitted to which of them the SQP steps of the planner converge from.

For hypotheses i with features x_i (see `learning.ranking`) and outcomes y_i (1 where the steps converge), the weights w
and the intercept b maximise the log-likelihood of a logistic regression,

    sum_i log p_i^y_i (1 - p_i)^(1 - y_i),    p_i = 1 / (1 + exp(-(w . x_i + b))).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm

from drake_gnnocp.budget import Budget
from drake_gnnocp.experiments.text import markdown_table
from drake_gnnocp.learning.checkpoint import Trained, load_weights, save_weights
from drake_gnnocp.learning.predict import hypotheses, interpolated
from drake_gnnocp.learning.ranking import Ranking
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.sqp import LEARNED, sqp_steps
from drake_gnnocp.planner import PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

RIDGE = 1e-5  # on squared weights of standardised features: keeps the fit finite where a feature is constant or decides
MOST_ITERATIONS = 500  # of L-BFGS


@dataclass(frozen=True)
class Observations:
    """Hypotheses and what became of them."""

    features: Tensor  # (N, N_FEATURES) in the order of the fields of `Ranking`, double
    converged: Tensor  # (N,) 1 where the SQP steps converged, else 0, double


def fit_ranking(path: Path, tasks: list[Scenario]) -> str:
    """Fit the ranking of the network in a file to tasks, write it into the file, and return a table of the change.

    Raises:
        WeightsError: the file does not hold weights.
        ValueError: there are no tasks.
    """
    if not tasks:
        raise ValueError(f"{path}: no validation task with a known solution to fit the ranking to")
    network, about = load_weights(path)
    seen = observations(network, tasks)
    rankings = before, after = network.ranking, fitted_ranking(seen)
    save_weights(path, replace(network, ranking=after), about)
    rows = [
        [name.replace("_", " "), *(_number(getattr(ranking, name)) for ranking in rankings)] for name in asdict(before)
    ]
    rows.append(["log-likelihood of a hypothesis", *(f"{log_likelihood(ranking, seen):.4f}" for ranking in rankings)])
    share = float(seen.converged.mean())
    note = f"{len(seen.converged)} hypotheses for {len(tasks)} tasks; the steps converged from {share:.0%}"
    return f"{markdown_table(['', 'before', 'after'], rows)}\n{note}"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def observations(network: Trained, tasks: list[Scenario]) -> Observations:
    """All hypotheses of a network for tasks anywhere, and whether the SQP steps from them converge."""
    features: list[list[float]] = []
    converged: list[bool] = []
    for task in tqdm(tasks, unit="task"):
        local = task.as_planned
        for hypothesis in hypotheses(network, local):
            guess = interpolated(hypothesis.points, hypothesis.duration, local, PlanOptions().knots)
            features.append(hypothesis.features.tolist())
            converged.append(converges(local, guess))
    return Observations(torch.tensor(features, dtype=torch.double), torch.tensor(converged, dtype=torch.double))


def converges(scenario: Scenario, guess: Trajectory) -> bool:
    """Whether the SQP steps that the planner takes from a learned guess converge; the scenario is near the origin."""
    options = PlanOptions()
    formulation = formulate(scenario, guess, options.cost, options.margin)
    return sqp_steps(formulation, LEARNED, Budget.unlimited()).converged


def fitted_ranking(seen: Observations) -> Ranking:
    """The ranking of the largest likelihood."""
    mean, scale = seen.features.mean(dim=0), seen.features.std(dim=0)
    scale = torch.where(scale > 0, scale, 1.0)
    weights, intercept, _ = _logistic_regression((seen.features - mean) / scale, seen.converged)
    weights = weights / scale
    values = [*weights.tolist(), intercept - float(weights @ mean)]
    return Ranking(*values)


def log_likelihood(ranking: Ranking, seen: Observations) -> float:
    """Mean log-likelihood of an observation under a ranking, with the intercept that suits it best."""
    promise = ranking.promise(seen.features)
    return _logistic_regression(seen.features[:, :0], seen.converged, promise)[2]


def _logistic_regression(columns: Tensor, outcome: Tensor, offset: Tensor | float = 0.0) -> tuple[Tensor, float, float]:
    """Weights (M,) of columns (N, M) and an intercept that are logits with an offset; and the mean log-likelihood."""
    weights = torch.zeros(columns.shape[1] + 1, dtype=torch.double, requires_grad=True)  # the intercept is the last
    optimiser = torch.optim.LBFGS(
        [weights], max_iter=MOST_ITERATIONS, tolerance_grad=1e-9, tolerance_change=1e-12, line_search_fn="strong_wolfe"
    )

    def loss() -> Tensor:
        return binary_cross_entropy_with_logits(columns @ weights[:-1] + weights[-1] + offset, outcome)

    def penalised() -> Tensor:
        optimiser.zero_grad()
        value = loss() + RIDGE * weights[:-1].square().sum()
        value.backward()
        return value

    optimiser.step(penalised)
    with torch.no_grad():
        return weights[:-1].detach(), weights[-1].item(), -loss().item()
