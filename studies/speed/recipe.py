"""What the paper's whole recipe takes on STAG's size, from what a frame and a view set take here."""

from dataclasses import dataclass

TRAIN_FRAMES, TEST_FRAMES = 36_531, 16_119  # anchors of STAG's `classification`, the paper's numbers
PRETRAIN_EPOCHS, FINETUNE_EPOCHS = 30, 15
TRIALS, PROTOCOLS = 10, 2


@dataclass(frozen=True)
class Costs:
    """Seconds of one way to compute.

    Attributes:
        frame: of a frame in pretraining; view_set: of a view set in fine-tuning.
        test_frame: of a frame that evaluation passes once for all trials, 0 where it does not; trial: of a view set in
            one trial.
    """

    frame: float
    view_set: float
    test_frame: float
    trial: float


def hours(costs: Costs) -> dict[str, float]:
    """Hours of pretraining, fine-tuning and evaluation, and of all together."""
    seconds = {
        "pretraining": PRETRAIN_EPOCHS * TRAIN_FRAMES * costs.frame,
        "fine-tuning": FINETUNE_EPOCHS * TRAIN_FRAMES * costs.view_set,
        "evaluation": TEST_FRAMES * costs.test_frame + TRIALS * PROTOCOLS * TEST_FRAMES * costs.trial,
    }
    return {name: value / 3600 for name, value in (seconds | {"together": sum(seconds.values())}).items()}


def arithmetic(costs: Costs) -> dict[str, str]:
    """How the hours of each part come about."""
    frames = f"{TEST_FRAMES:,} frames x {1e3 * costs.test_frame:.3g} ms + " if costs.test_frame else ""
    return {
        "pretraining": f"{PRETRAIN_EPOCHS} x {TRAIN_FRAMES:,} frames x {1e3 * costs.frame:.3g} ms",
        "fine-tuning": f"{FINETUNE_EPOCHS} x {TRAIN_FRAMES:,} view sets x {1e3 * costs.view_set:.3g} ms",
        "evaluation": f"{frames}{TRIALS} x {PROTOCOLS} x {TEST_FRAMES:,} view sets x {1e3 * costs.trial:.3g} ms",
        "together": "",
    }


def rows(fast: Costs, plain: Costs, view_sets: dict[str, float]) -> list[dict]:
    """A row for each part of the recipe and for all of it; and the fine-tuning in other ways.

    Args:
        view_sets: seconds of a view set in fine-tuning, by what was changed.
    """
    took, plainly = hours(fast), hours(plain)
    shown, plainly_shown = arithmetic(fast), arithmetic(plain)
    found = [
        {
            "part": name,
            "fast hours": took[name],
            "plain hours": plainly[name],
            "ratio": plainly[name] / took[name],
            "fast": shown[name],
            "plain": plainly_shown[name],
        }
        for name in took
    ]
    for name, seconds in view_sets.items():
        other = Costs(fast.frame, seconds, fast.test_frame, fast.trial)
        for part in ("fine-tuning", "together"):
            value = hours(other)[part]
            found.append(
                {
                    "part": f"{part}, {name}",
                    "fast hours": value,
                    "plain hours": plainly[part],
                    "ratio": plainly[part] / value,
                    "fast": arithmetic(other)[part],
                    "plain": "",
                }
            )
    return found
