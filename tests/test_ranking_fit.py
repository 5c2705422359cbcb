"""The ranking fitted to a network: known weights are found again, and the file keeps what was fitted."""

from __future__ import annotations

from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
import torch

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.experiments.training import ranking_fit
from drake_gnnocp.experiments.training.ranking_fit import Observations, fit_ranking, fitted_ranking, log_likelihood
from drake_gnnocp.learning.checkpoint import load_weights, save_weights
from drake_gnnocp.learning.configs import PaperConfig
from drake_gnnocp.learning.paper_network import PaperNetwork
from drake_gnnocp.learning.ranking import N_FEATURES, Ranking
from drake_gnnocp.learning.trainable import trained

KNOWN = Ranking(
    score=0.5, defect=-20.0, largest_defect=-1.0, penetration=-8.0, duration=-0.1, gear_changes=-0.4, intercept=0.7
)
SPREAD = (2.0, 0.05, 0.6, 0.1, 10.0, 2.0)  # of the features: each moves the logit by 0.6 to 1
SAMPLING = 0.1  # relative, of weights that are fitted to 20,000 outcomes


def drawn(ranking: Ranking, n: int) -> Observations:
    rng = torch.Generator().manual_seed(0)
    features = torch.randn(n, N_FEATURES, generator=rng, dtype=torch.double) * torch.tensor(SPREAD)
    assert ranking.intercept is not None
    share = torch.sigmoid(ranking.promise(features) + ranking.intercept)
    return Observations(features, (torch.rand(n, generator=rng, dtype=torch.double) < share).double())


def test_the_fit_finds_the_weights_that_outcomes_were_drawn_with() -> None:
    assert astuple(fitted_ranking(drawn(KNOWN, 20_000))) == pytest.approx(astuple(KNOWN), rel=SAMPLING)


def test_a_fit_is_likelier_than_any_other_ranking() -> None:
    seen = drawn(KNOWN, 2_000)
    best = log_likelihood(fitted_ranking(seen), seen)
    assert log_likelihood(KNOWN, seen) < best
    assert log_likelihood(Ranking(), seen) < log_likelihood(KNOWN, seen)


def test_of_hypotheses_with_a_probability_as_many_converge() -> None:
    seen = drawn(KNOWN, 20_000)
    ranking = fitted_ranking(drawn(KNOWN, 2_000))
    predicted = torch.tensor([ranking.probability(promise) for promise in ranking.promise(seen.features).tolist()])
    for low in (0.1, 0.3, 0.5, 0.7, 0.9):
        these = (predicted - low).abs() < 0.05
        assert these.sum() > 300
        assert seen.converged[these].mean().item() == pytest.approx(predicted[these].mean().item(), abs=0.06)


def test_probabilities_are_such_however_large_the_logit_is() -> None:
    ranking = Ranking(intercept=0.0)
    assert [ranking.probability(logit) for logit in (-1e6, 0.0, 1e6)] == [0.0, 0.5, 1.0]


def test_without_a_fit_there_is_no_probability() -> None:
    assert Ranking().probability(1.0) is None


def test_a_feature_that_never_changes_gets_no_weight() -> None:
    seen = drawn(KNOWN, 2_000)
    seen.features[:, 0] = 3.0
    assert fitted_ranking(seen).score == 0.0


def test_the_fit_is_written_into_the_file_of_the_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def is_long(scenario: Scenario, guess: Trajectory) -> bool:
        return guess.duration > 12.0

    monkeypatch.setattr(ranking_fit, "converges", is_long)
    torch.manual_seed(0)
    path = tmp_path / "w.safetensors"
    network = PaperNetwork(PaperConfig(hidden=16))
    save_weights(path, trained(network), {"epoch": 3})
    tasks = [Scenario("task", np.zeros(3), np.array([x, 2.0, 0.5])) for x in np.linspace(4.0, 20.0, 8)]
    table = fit_ranking(path, tasks)
    found, about = load_weights(path)
    assert found.ranking != network.ranking and about == {"epoch": 3}
    assert f"| duration | 0 | {found.ranking.duration:.4g} |" in table
    for name, weights in network.state_dict().items():
        np.testing.assert_array_equal(found.arrays[name], weights)
