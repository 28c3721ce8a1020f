"""The checks, their outcomes, and the questions that files cannot answer; never an all-clear."""

from dataclasses import dataclass

from tactile_viewgcn.messages import Note, several

#: What each check looks for, by the topics of its warnings.
CHECKS = {
    "frames that two recordings have in common": ("copies", "shared frames"),
    "recordings or sensors that stand still": ("standing still",),
    "equal frames at the ends of recordings": ("equal ends",),
    "units that differ four times or more": ("unit",),
    "columns that are no sensor": ("columns",),
    "times and frame rates": ("time", "frame rate"),
    "names that differ only in spelling": ("spelling",),
    "recordings and objects without frames": ("no frames", "contact"),
    "objects that are recognised without contact": ("leak check",),
}
#: Topics of the checks that look at how readings change from frame to frame, and these checks.
OF_MOTION = {"standing still", "equal ends", "unit", "columns"}
NEED_FRAMES = [what for what, topics in CHECKS.items() if OF_MOTION.intersection(topics)]
#: What the files cannot tell.
UNKNOWN = (
    "Is a recording an augmented, filtered or resampled copy of another one? Then leave it out.",
    "Were recordings cut from a longer recording, or made in one go? Then give them one session.",
    "Who made a recording, and when? Only folders, columns and names can say so.",
    "Is each label right? Will new recordings be made in the same way?",
)


@dataclass(frozen=True)
class Check:
    """A check: what it looks for, its outcome in words, and whether it gave a warning."""

    what: str
    outcome: str
    warned: bool = False


def outcomes(warned: list[Note], not_made: dict[str, str]) -> list[Check]:
    """Return the outcome of each check.

    Args:
        warned: all warnings. Warnings whose topic belongs to no check are counted at the end.
        not_made: by what a check looks for, why it was not made.
    """
    topics = [note.topic for note in warned]
    checks = list[Check]()
    known_topics = set[str]()
    for what, check_topics in CHECKS.items():
        known_topics.update(check_topics)
        count = sum(topic in check_topics for topic in topics)
        if count:
            checks.append(Check(what, several(count, "warning"), warned=True))
        else:
            checks.append(Check(what, not_made.get(what, "nothing found")))
    others = sum(topic not in known_topics for topic in topics)
    if others:
        checks.append(Check("all else", several(others, "warning"), warned=True))
    return checks
