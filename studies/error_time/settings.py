"""What is varied: along each axis, the recipe with some of its keys changed."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any


@dataclass(frozen=True)
class Setting:
    """One recipe: the axis it stands on, its place there, and what it changes, {"section.key": value}."""

    axis: str
    value: str
    changes: dict[str, Any]


def settings(params: SimpleNamespace) -> list[Setting]:
    """Every recipe that is trained; those that change nothing of the default's are trained once."""
    shares = {"1/8": 1 / 8, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0}
    budgets = [Setting("time", name, schedule(params, share)) for name, share in shares.items()]
    views = [Setting("views", str(count), {"views": count, "viewpoints": "auto"}) for count in (1, 2, 4, 8, 12)]
    widths = [Setting("width", str(width), {"model.backbone.width": width}) for width in (16, 32, 64)]
    return budgets + views + widths + reuses()


def reuses() -> list[Setting]:
    """The number of view sets that share a feature."""
    return [Setting("reuse", str(count), {"finetune.reuse": count}) for count in (1, 2, 4, 8)]


def schedule(params: SimpleNamespace, share: float) -> dict[str, int]:
    """Both trainings at a share of their epochs, the learning rate falling as much as in the whole."""
    return {
        "pretrain.epochs": max(1, round(share * params.pretrain.epochs)),
        "pretrain.halve_every": max(1, round(share * params.pretrain.halve_every)),
        "finetune.epochs": max(1, round(share * params.finetune.epochs)),
    }


def changed(params: SimpleNamespace, changes: dict[str, Any]) -> SimpleNamespace:
    """The parameters with the changes made."""
    found = dict(vars(params))
    for key, value in changes.items():
        section, _, rest = key.partition(".")
        found[section] = _replaced(found[section], rest, value)
    return SimpleNamespace(**found)


def _replaced(section: Any, key: str, value: Any) -> Any:
    """The section with the value under a dotted key of its own; the value itself without a key."""
    if not key:
        return value
    name, _, rest = key.partition(".")
    return replace(section, **{name: _replaced(getattr(section, name), rest, value)})
