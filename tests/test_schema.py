"""The JSON Schema of scenarios and their reader: what one takes the other takes, wherever a schema can say it."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

import drake_gnnocp
from drake_gnnocp import Scenario, Vehicle, bundled_scenarios
from drake_gnnocp.scenario import ScenarioError
from drake_gnnocp.scenario_files import KEYS

ROOT = Path(drake_gnnocp.__file__).parents[1]
SCHEMA = json.loads((ROOT / "drake_gnnocp" / "scenario.schema.json").read_text(encoding="utf-8"))
VALIDATOR = Draft202012Validator(SCHEMA)
PAGE = (ROOT / "docs" / "scenario.md").read_text(encoding="utf-8")
EXAMPLES = [json.loads(text) for text in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)]
BEYOND = re.compile(  # what the reader checks beyond the schema; the page lists it
    r"bounds: must be \[xmin, xmax, ymin, ymax\] with min < max|(start|goal): the car (collides|leaves)"
    r"|goals: the car can stand at none"
    r"|(obstacles\[\d+\]|bounds): (has|crosses|its holes|must not touch)|name: must (have no slashes|be at most)"
)
RING = [[50, 50], [60, 50], [60, 60], [50, 60]]  # far from the poses
FULL: dict[str, Any] = {
    **{"name": "all", "start": [0, 0, 0], "goal": [20, 0, 0], "goals": None},
    "goal_tolerance": {"x": 0.5, "y": 0.1, "heading": 0.2},
    "obstacles": [RING, {"ring": RING, "holes": [[[52, 52], [54, 52], [54, 54]]]}],
    "lines": [[[30, 30], [40, 30], [40, 40]]],
    "points": [[-30, -30], [-40, -40, 0.5]],
    "bounds": [-500, 500, -500, 500],
    "clearance": 0.1,
    "vehicle": asdict(Vehicle()),
}
CELLS: list[Any] = [
    *(None, True, False, 0, -1, 0.5, 3, 1e-4, 99.9, 100.5, 1e12, 2e12, -2e12, 1.5707963267948966, 1e5),
    *("", " . ", "a/b", "name", "ä" * 60, "x" * 101, "tab\t", "end\n", "\u200b", [], {}, [[]], [0], [0, 0], [0, 0, 0]),
    *(
        [0, 0, None],
        [0, 0, 0, 0],
        [9, -9, 9, -9],
        RING,
        [RING],
        RING[:2],
        RING[:1],
        [RING[:2]],
        {"ring": RING},
        {"a": 1},
    ),
    *({"ring": RING, "holes": None}, {"ring": RING, "holes": 0}, {"holes": []}, [[0, 0, -1]], [[5, 5, None]]),
]


cells = st.sampled_from(CELLS).map(lambda cell: json.loads(json.dumps(cell)))


@st.composite
def documents(draw: st.DrawFn) -> Any:
    """Documents in which mostly one value, however deep, is another one, is left out, or has one more beside it."""
    data: Any = json.loads(json.dumps(FULL))
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        holder: Any = data
        while holder:
            key = draw(st.sampled_from(sorted(holder) if isinstance(holder, dict) else list(range(len(holder)))))
            if isinstance(holder[key], dict | list) and holder[key] and draw(st.integers(0, 4)):
                holder = holder[key]
                continue
            change = draw(st.sampled_from(["replace", "replace", "replace", "remove", "add"]))
            if change == "remove":
                del holder[key]
            elif change == "replace":
                holder[key] = draw(cells)
            elif isinstance(holder, dict):
                holder[draw(st.sampled_from(["more", "width", "holes", "ring", "goal"]))] = draw(cells)
            else:
                holder.append(draw(cells | st.just(json.loads(json.dumps(holder[key])))))
            break
    if draw(st.integers(0, 3)) == 0 and isinstance(data, dict):
        data |= {"goal": None, "goals": draw(st.lists(cells, max_size=3) | cells)}
    return data


def refusal(data: Any) -> str:
    """What the reader says of a document; nothing where it takes it."""
    try:
        Scenario.from_dict(data)
    except ScenarioError as error:
        return str(error)
    return ""


def test_the_schema_is_one_and_has_the_keys_of_the_reader() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["properties"]) == set(KEYS)
    parameters = SCHEMA["properties"]["vehicle"]["anyOf"][0]["properties"]
    assert {name: parameter["default"] for name, parameter in parameters.items()} == asdict(Vehicle())


@pytest.mark.parametrize("name", bundled_scenarios())
def test_bundled_scenarios_are_valid(name: str) -> None:
    VALIDATOR.validate(json.loads((ROOT / "drake_gnnocp" / "scenarios" / f"{name}.json").read_text(encoding="utf-8")))
    VALIDATOR.validate(Scenario.load(name).to_dict())


@settings(max_examples=300, deadline=None)
@given(documents())
@example(FULL)
@example({**FULL, "goal": [20, 0, None]})
@example({**FULL, "goal": None, "goals": [[20, 0, None], [0, 0, 0]]})
@example({**FULL, "goals": [[20, 0, 0]]})
@example({**FULL, "goal": None})
@example([])
def test_what_the_schema_takes_the_reader_takes_and_the_other_way_round(data: Any) -> None:
    said = refusal(data)
    if BEYOND.match(said):
        return
    assert VALIDATOR.is_valid(data) == (not said), said or [error.message for error in VALIDATOR.iter_errors(data)]


@given(documents())
def test_what_is_read_gives_a_valid_document_again(data: Any) -> None:
    if refusal(data):
        return
    again = Scenario.from_dict(data).to_dict()
    VALIDATOR.validate(again)
    assert Scenario.from_dict(again).to_dict() == again


def test_the_page_names_every_key_and_its_examples_are_scenarios() -> None:
    table = re.findall(r"^\| (`.*?`) \|", PAGE, re.MULTILINE)
    assert {key for row in table for key in re.findall(r"`(\w+)`", row)} >= set(KEYS) | set(asdict(Vehicle()))
    for data in EXAMPLES:
        if "type" not in data:
            VALIDATOR.validate(data)
            Scenario.from_dict(data)


def test_the_page_s_geojson_is_read(tmp_path: Path) -> None:
    drawn = [data for data in EXAMPLES if "type" in data]
    assert len(drawn) == 1
    (tmp_path / "page.geojson").write_text(json.dumps(drawn[0]))
    assert Scenario.load(tmp_path / "page.geojson").clearance == 0.1
