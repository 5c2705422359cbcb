"""The scenarios of the benchmarks: bundled ones, files, random tasks, and tasks on maps that no network was trained on.

The last are drawn as those of the dataset are, on its test maps, but not read from it: it holds only what Hybrid A*
could solve. They are taken round-robin: the first pair of start and goal of every map, then the second one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from drake_gnnocp.experiments.dataset.generate import DatasetSettings
from drake_gnnocp.experiments.dataset.records import split_of
from drake_gnnocp.experiments.tasks.draw import draw_place, draw_task, kind_of
from drake_gnnocp.experiments.tasks.open_maps import random_task
from drake_gnnocp.experiments.tasks.place import TIGHT, WIDE_KINDS
from drake_gnnocp.scenario import Scenario, bundled_scenarios

LIBRARY, FILE = "library", "file"  # kinds of scenarios with a name; the others are the kinds of places
NAMED = (LIBRARY, FILE)
DATASET = DatasetSettings()


def _test_maps() -> tuple[int, ...]:
    """Test maps in the shares of the paper's maps, evenly mixed: of six four are open, one a car park, one a yard."""
    of_kind = {
        kind: [i for i in range(DATASET.maps) if (split_of(i), kind_of(i)) == ("test", kind)] for kind in WIDE_KINDS
    }
    most = {kind: len(of_kind["open"]) // (1 if kind == "open" else 4) for kind in WIDE_KINDS}
    placed = [((n + 0.5) / most[kind], i) for kind in WIDE_KINDS for n, i in enumerate(of_kind[kind][: most[kind]])]
    return tuple(index for _, index in sorted(placed))


TEST_MAPS = _test_maps()
TIGHT_TEST_MAPS = tuple(i for i in range(DATASET.maps) if (split_of(i), kind_of(i)) == ("test", TIGHT))


@dataclass(frozen=True)
class Task:
    """A scenario and where it is from."""

    scenario: Scenario
    kind: str  # one of NAMED, the kind of the place it was drawn on, or the seed of random tasks

    @property
    def key(self) -> tuple[str, str]:
        """What it is told apart by."""
        return self.scenario.name, self.kind

    @property
    def local(self) -> Scenario:
        """The scenario with its start at the origin, as the solvers want it."""
        x0, y0, _ = self.scenario.start
        return self.scenario.translated(-x0, -y0)


def named_tasks(sources: list[str]) -> list[Task]:
    """Scenarios by bundled names and paths.

    Raises:
        ValueError: one is no scenario, or two of them have the same name.
    """
    bundled = bundled_scenarios()
    tasks: dict[tuple[str, str], Task] = {}
    for source in dict.fromkeys(sources):
        task = Task(Scenario.load(source), LIBRARY if source in bundled else FILE)
        if task.key in tasks:
            raise ValueError(f"{source}: name: another file's scenario is called {task.scenario.name!r} as well")
        tasks[task.key] = task
    return list(tasks.values())


def random_tasks(seed: int, n: int) -> list[Task]:
    """The first n random tasks of a seed, see `drake_gnnocp.experiments.tasks.open_maps`."""
    return [Task(random_task(seed, i), f"random, seed {seed}") for i in range(n)]


def drawn_tasks(n: int) -> list[Task]:
    """The first n tasks on test maps that are not tight, or as many as there are."""
    return list(itertools.islice(_drawn(TEST_MAPS), n))


def tight_tasks(n: int) -> list[Task]:
    """The first n tasks in tight places of the test, or as many as there are."""
    return list(itertools.islice(_drawn(TIGHT_TEST_MAPS), n))


def _drawn(maps: Sequence[int]) -> Iterator[Task]:
    places = {}
    for pair in range(DATASET.pairs):
        for index in maps:
            if index not in places:
                places[index] = draw_place(DATASET.seed, index)
            scenario = draw_task(DATASET.seed, index, places[index], pair)
            if scenario is not None:
                yield Task(scenario, kind_of(index))
