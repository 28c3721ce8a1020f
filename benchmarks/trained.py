"""The pipeline's trained classifier and its frames, for the table of stability."""

from dataclasses import replace
from pathlib import Path

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import Params
from tactile_viewgcn.recognition.calibration import Classifier
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import Frames, load_table

# as `dvc repro` leaves them
FRAMES = Path("data/frames")
CLASSIFIER = Path("models/classifier.pt")


def read_trained(
    frames: Path, classifier: Path, params: Params
) -> tuple[Classifier, Frames, Params]:
    """Return the trained classifier, its frames, and the parameters with its `model`.

    Args:
        frames: table of the frames that the classifier was trained on and is tested on.
        classifier: file of the classifier.
        params: all other parameters.

    Returns:
        The classifier in evaluation mode, the table of frames, and the parameters.

    Raises:
        UserError: a file is missing, or the classifier has other classes or sensors than the
            frames.
    """
    for path in (frames, classifier):
        if not path.exists():
            raise UserError(f"{path}: no such file or folder; run `dvc repro`, which makes it")
    table = load_table(frames, Frames)
    trained, content = load_classifier(classifier)
    same_classes = content.classes == table.classes
    same_sensors = content.plan.live.shape == table.live.shape
    if not (same_classes and same_sensors):
        raise UserError(
            f"{classifier}: other classes or sensors than {frames} has; train it on these frames"
        )
    return trained, table, replace(params, model=content.model, views=trained.views)
