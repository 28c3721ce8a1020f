"""The hand: a palm and five jointed fingers that carry STAG's 548 sensors.

Axes of the palm: x towards the fingertips, y from the little finger to the thumb, z out of the palm
towards the object. Lengths are in m, and the wrist is at x = 0. Each finger has three flexion
joints and two coordinates: the base joint bends by q[0], the middle one by q[1] and the last one by
2/3 q[1], as the tendons of a human finger couple them. The opposition angle rotates the thumb's
plane of flexion about x.

Where the sensors sit in the 32 x 32 frame follows the description of STAG (Sundaram et al., Nature
569, 698-702 (2019)); lengths are those of an adult hand.
"""

from dataclasses import dataclass

import numpy as np

SHAPE = (32, 32)
# a finger's joint angles (3) from its unknowns (2)
COUPLING = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 2 / 3]])
# m: proximal, middle and distal link of little to index finger; metacarpal to distal of the thumb
LINKS = np.array(
    [
        [0.033, 0.020, 0.018],
        [0.043, 0.026, 0.020],
        [0.046, 0.029, 0.021],
        [0.041, 0.025, 0.020],
        [0.044, 0.032, 0.026],
    ]
)
BASES = np.array(  # m: the base joint of each finger
    [
        [0.082, -0.032, 0],
        [0.088, -0.011, 0],
        [0.090, 0.010, 0],
        [0.087, 0.031, 0],
        [0.026, 0.036, 0.004],
    ]
)
# rad about z, of the little to the index finger
FINGER_SPREAD = np.array([-0.16, -0.06, 0.02, 0.10])
THUMB_ANGLE = 0.98  # rad between x and the straight, unopposed thumb
RADIUS = 0.008  # m from a finger's bone to its skin
SIDE_TILT = 0.45  # rad by which a finger's outer rows of sensors are tilted aside
PALM = (0.090, 0.084)  # m: length and width that the sensors cover
PALM_CUP = 0.007  # m by which the palm's edges are higher than its middle
TILE = 6  # a patch of the palm has TILE x TILE sensors
# the first patches are the fingers' links, three each; the others belong to the palm
LINK_PATCHES = 15
#: of a hand: its size relative to the usual one, and m along and aside by which its glove is
#: shifted
Fit = tuple[float, tuple[float, float]]
USUAL: Fit = (1.0, (0.0, 0.0))


@dataclass(frozen=True)
class Pose:
    """Positions and orientations of the N patches of R hands, in the palm's axes.

    Attributes:
        origin: (R, N, 3) m, the joint of a link; 0 for the palm.
        axes: (R, N, 3, 3), columns: along the link, aside, and out of the skin.
        hinge: (R, 5, 3) axis about which each finger flexes.
    """

    origin: np.ndarray
    axes: np.ndarray
    hinge: np.ndarray


@dataclass
class Hands:
    """B hands with the same S sensors, sorted by the patch that carries them, of N patches.

    A patch belongs to one link or to the palm. The hands differ in size and in the glove's shift.

    Attributes:
        row, column: (S,) cell in the frame.
        patch: (S,) 3 x finger + link, or LINK_PATCHES and above on the palm.
        local: (B, S, 3) m, position; normal: (B, S, 3). The axes of a link point along it from its
            joint, aside, and out of the skin; on the palm they are the palm's.
        area: (B, S) m^2 of skin under each sensor.
        bases: (B, 5, 3) m, the fingers' base joints; links: (B, 5, 3) m, lengths.
        start, count: (N,) first sensor of each patch, and number of its sensors.
        centre: (B, N, 3) m in the patch's axes, and bounding_radius: (N,) m, of a sphere around
            each patch's sensors.
    """

    row: np.ndarray
    column: np.ndarray
    patch: np.ndarray
    local: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    bases: np.ndarray
    links: np.ndarray

    def __post_init__(self) -> None:
        patches = np.arange(max(self.patch.max() + 1, LINK_PATCHES))
        self.start = np.searchsorted(self.patch, patches)
        self.count = np.searchsorted(self.patch, patches, side="right") - self.start
        self.centre, self.bounding_radius = (
            np.zeros((len(self.local), len(patches), 3)),
            np.zeros(len(patches)),
        )
        for n, (first, count) in enumerate(zip(self.start, self.count, strict=True)):
            if count:
                local = self.local[:, first : first + count]
                self.centre[:, n] = local.mean(axis=1)
                self.bounding_radius[n] = np.linalg.norm(
                    local - self.centre[:, n, None], axis=-1
                ).max()

    def pose(self, rows: np.ndarray, q: np.ndarray, opposition: np.ndarray) -> "Pose":
        """Forward kinematics of hands `rows` (R,) at joint coordinates q (R, 5, 2) rad and opposition (R,) rad."""
        along, aside, skin = _finger_axes(opposition)  # (R, 5, 3) each
        angle = np.cumsum(q @ COUPLING.T, axis=-1)[..., None]  # (R, 5, 3, 1)
        cos, sin = np.cos(angle), np.sin(angle)
        ahead = cos * along[:, :, None] + sin * skin[:, :, None]  # along each link (R, 5, 3, 3)
        out = cos * skin[:, :, None] - sin * along[:, :, None]  # out of its skin
        steps = self.links[rows][..., None] * ahead
        origin = np.zeros((len(rows), len(self.start), 3))
        axes = np.zeros((len(rows), len(self.start), 3, 3))
        joint = self.bases[rows][:, :, None] + np.cumsum(steps, axis=2) - steps
        origin[:, :LINK_PATCHES] = joint.reshape(len(rows), LINK_PATCHES, 3)
        sides = np.broadcast_to(aside[:, :, None], ahead.shape)
        axes[:, :LINK_PATCHES] = np.stack([ahead, sides, out], axis=-1).reshape(
            len(rows), LINK_PATCHES, 3, 3
        )
        axes[:, LINK_PATCHES:] = np.eye(3)
        return Pose(origin, axes, -aside)


def stag_hands(*fits: Fit) -> Hands:
    """STAG's sensors on one hand of the usual size, or on a hand for each of the fits."""
    fits = fits or (USUAL,)
    each = [_stag_sensors(*fit) for fit in fits]
    row, column, patch, local, normal, area = (
        np.stack(values) for values in zip(*each, strict=True)
    )
    scale = np.array([scale for scale, _ in fits])[:, None, None]
    return Hands(row[0], column[0], patch[0], local, normal, area, BASES * scale, LINKS * scale)


def _stag_sensors(scale: float, slip: tuple[float, float]) -> list[np.ndarray]:
    """Row, column, patch, local, normal and area of the sensors of one hand, see `Fit`, sorted by patch."""
    parts = []
    for finger, first in enumerate((0, 6, 10, 15)):
        row, column = np.mgrid[first : first + 3, 0:14].reshape(2, -1)
        parts.append(
            (
                row,
                column,
                *_on_finger(finger, (13.5 - column) / 14, row - first - 1.0, 3, scale, slip),
            )
        )
    row, column = np.mgrid[18:32, 25:29].reshape(2, -1)
    parts.append((row, column, *_on_finger(4, (row - 17.5) / 14, 26.5 - column, 4, scale, slip)))
    row, column = np.mgrid[0:18, 14:32].reshape(2, -1)
    parts.append((row, column, *_on_palm(row, column - 14, scale, slip)))
    values = [np.concatenate(each) for each in zip(*parts, strict=True)]
    order = np.argsort(values[2], kind="stable")
    return [each[order] for each in values]


def _on_finger(
    finger: int,
    along: np.ndarray,
    aside: np.ndarray,
    across: int,
    scale: float,
    slip: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Patch, local, normal and area of a finger's n sensors.

    `along` (n,) goes from 0 at the base to 1 at the tip; `aside` (n,) counts rows from the middle
    one; `across` is the number of rows.
    """
    ends = np.cumsum(LINKS[finger]) * scale
    distance = along * ends[-1]
    link = np.searchsorted(ends[:2], distance, side="right")
    step = 2 * SIDE_TILT / (across - 1)
    tilt, radius = aside * step, RADIUS * scale
    start, zero = np.concatenate([[0], ends[:2]])[link], np.zeros(len(link))
    local = np.stack(
        [distance - start + slip[0], radius * np.sin(tilt) + slip[1], radius * np.cos(tilt)], axis=1
    )
    normal = np.stack([zero, np.sin(tilt), np.cos(tilt)], axis=1)
    return 3 * finger + link, local, normal, np.full(len(link), ends[-1] / 14 * radius * step)


def _on_palm(
    row: np.ndarray, column: np.ndarray, scale: float, slip: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Patch, local, normal and area of the palm's 18 x 18 sensors; columns are counted from the fingers."""
    length, width = PALM[0] * scale, PALM[1] * scale
    x, y = (17.5 - column) / 18 * length + slip[0], (row - 8.5) / 18 * width + slip[1]
    cup = PALM_CUP * scale * (2 / width) ** 2
    normal = np.stack([np.zeros(len(y)), -2 * cup * y, np.ones(len(y))], axis=1)
    patch = LINK_PATCHES + row // TILE * (18 // TILE) + column // TILE
    local = np.stack([x, y, cup * y**2], axis=1)
    area = np.full(len(y), length * width / 18**2)
    return patch, local, normal / np.linalg.norm(normal, axis=1, keepdims=True), area


def _finger_axes(opposition: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes of straight fingers, (R, 5, 3) each: along, aside, and out of the skin; opposition (R,) rad."""
    count = len(opposition)
    along, aside, skin = np.zeros((count, 5, 3)), np.zeros((count, 5, 3)), np.zeros((count, 5, 3))
    along[:, :4, 0], along[:, :4, 1] = np.cos(FINGER_SPREAD), np.sin(FINGER_SPREAD)
    aside[:, :4, 0], aside[:, :4, 1] = -np.sin(FINGER_SPREAD), np.cos(FINGER_SPREAD)
    skin[:, :4, 2] = 1
    cos, sin = np.cos(opposition), np.sin(opposition)
    lean = np.cos(THUMB_ANGLE), np.sin(THUMB_ANGLE)
    along[:, 4] = np.stack([np.full(count, lean[0]), lean[1] * cos, lean[1] * sin], axis=1)
    aside[:, 4] = np.stack([np.full(count, -lean[1]), lean[0] * cos, lean[0] * sin], axis=1)
    skin[:, 4] = np.stack([np.zeros(count), -sin, cos], axis=1)
    return along, aside, skin
