"""Fields of options changed from the command line, as in `--set hypotheses=1 kinematics=0`."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def override(options: T, settings: dict[str, str]) -> T:
    """A dataclass with some fields changed, those of dataclasses inside it as well; what is used up is taken out.

    Args:
        options: whose fields are bool, int, float or such dataclasses.
        settings: new values by field name; on return those that are no field of `options`.

    Raises:
        ValueError: a value does not fit its field.
    """
    changed: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value) and not isinstance(value, type):
            changed[field.name] = override(value, settings)
        elif field.name in settings:
            changed[field.name] = _parsed(field.name, settings.pop(field.name), type(value))
    return replace(options, **changed)


def _parsed(name: str, text: str, kind: type) -> Any:
    try:
        return bool(int(text)) if kind is bool else kind(text)
    except ValueError:
        raise ValueError(f"--set {name}: must be a number ({kind.__name__}), not {text!r}") from None
