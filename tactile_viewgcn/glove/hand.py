"""The hand: a palm and five jointed fingers that carry STAG's 548 sensors.

The palm has three axes: x points towards the fingertips, y from the little finger to the thumb, and
z out of the palm towards the object. Lengths are in m, and the wrist is at x = 0. Each finger has
three flexion joints and two coordinates, since the tendons of a human finger couple the joints. The
base joint bends by q[0], the middle one by q[1] and the last one by 2/3 q[1]. The opposition angle
rotates the thumb's plane of flexion about x.

The cells of the sensors in the 32 x 32 frame follow the description of STAG (Sundaram et al.,
Nature 569, 698-702 (2019)). The lengths are typical of an adult hand.
"""

from dataclasses import dataclass

import numpy as np

SHAPE = (32, 32)
# a finger's joint angles (3) from its unknowns (2)
COUPLING = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 2 / 3]])
# m: proximal to distal link of little to index finger; metacarpal to distal link of the thumb
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
SIDE_TILT = 0.45  # rad by which the outer rows of a finger's sensors are tilted aside
PALM = (0.090, 0.084)  # m: length and width that the sensors cover
PALM_CUP = 0.007  # m by which the edges of the palm are higher than its middle
TILE = 6  # a patch of the palm has TILE x TILE sensors
FINGERS = 5
LINKS_OF_FINGER = 3
THUMB = 4  # number of the last finger
PARTS = FINGERS + 1  # parts of a hand: its fingers and the palm
# the first patches are the links of the fingers, three for each; the others belong to the palm
LINK_PATCHES = FINGERS * LINKS_OF_FINGER
# (3, 5, 3): axes along each straight finger, aside, and out of its skin; entries that turn with the
# thumb's opposition are 0 here
UNOPPOSED = np.zeros((3, 5, 3))
UNOPPOSED[0, :THUMB, 0] = np.cos(FINGER_SPREAD)
UNOPPOSED[0, :THUMB, 1] = np.sin(FINGER_SPREAD)
UNOPPOSED[1, :THUMB, 0] = -np.sin(FINGER_SPREAD)
UNOPPOSED[1, :THUMB, 1] = np.cos(FINGER_SPREAD)
UNOPPOSED[2, :THUMB, 2] = 1
UNOPPOSED[:2, THUMB, 0] = [np.cos(THUMB_ANGLE), -np.sin(THUMB_ANGLE)]
#: Fit of a glove: size of the hand relative to the usual one, and shift of the glove along and
#: aside, in m.
Fit = tuple[float, tuple[float, float]]
USUAL: Fit = (1.0, (0.0, 0.0))


@dataclass(frozen=True)
class Pose:
    """Positions and orientations of the N patches of R hands, in the palm's axes.

    Attributes:
        origin: (R, N, 3) m, position of a link's joint; 0 for the palm.
        axes: (R, N, 3, 3) axes as columns: along the link, aside, and out of the skin.
        hinge: (R, 5, 3) axis about which each finger flexes.
    """

    origin: np.ndarray
    axes: np.ndarray
    hinge: np.ndarray


@dataclass
class Hands:
    """B hands with the same S sensors on the same N patches.

    A patch belongs to one link or to the palm. Sensors are sorted by patch. The hands differ in
    size and in the shift of the glove.

    Attributes:
        row, column: (S,) cell of each sensor in the frame.
        patch: (S,) patch of each sensor: 3 x finger + link, or LINK_PATCHES and above on the palm.
        local: (B, S, 3) m, position in the patch's axes. The axes of a link point along it from its
            joint, aside, and out of the skin. Patches on the palm have the palm's axes.
        normal: (B, S, 3) unit vector out of the skin, in the patch's axes.
        area: (B, S) m^2, area of skin under each sensor.
        bases: (B, 5, 3) m, positions of the fingers' base joints.
        links: (B, 5, 3) m, lengths of the fingers' links.
        start: (N,) index of the first sensor of each patch.
        count: (N,) number of sensors of each patch.
        centre: (B, N, 3) m, centre of a sphere around each patch's sensors, in the patch's axes.
        bounding_radius: (N,) m, radius of that sphere.
        from_centre: (B, S) m, distance of each sensor from the centre of its patch's sphere.
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
        self.centre = np.zeros((len(self.local), len(patches), 3))
        self.bounding_radius = np.zeros(len(patches))
        self.from_centre = np.zeros(self.area.shape)
        for patch in patches[self.count > 0]:
            first = self.start[patch]
            local = self.local[:, first : first + self.count[patch]]
            self.centre[:, patch] = local.mean(axis=1)
            from_centre = np.linalg.norm(local - self.centre[:, patch, None], axis=-1)
            self.bounding_radius[patch] = from_centre.max()
            self.from_centre[:, first : first + self.count[patch]] = from_centre

    def pose(self, rows: np.ndarray, q: np.ndarray, opposition: np.ndarray) -> Pose:
        """Return the pose of some hands, by forward kinematics.

        Args:
            rows: (R,) indices of the hands.
            q: (R, 5, 2) rad, joint coordinates.
            opposition: (R,) rad, opposition of the thumbs.
        """
        count = len(rows)
        along, aside, skin = _finger_axes(opposition)  # (R, 5, 3) each
        angle = np.cumsum(q @ COUPLING.T, axis=-1)[..., None]  # (R, 5, 3, 1)
        cos = np.cos(angle)
        sin = np.sin(angle)
        ahead = cos * along[:, :, None] + sin * skin[:, :, None]  # along each link (R, 5, 3, 3)
        out = cos * skin[:, :, None] - sin * along[:, :, None]  # out of its skin
        steps = self.links[rows][..., None] * ahead
        joint = self.bases[rows][:, :, None] + np.cumsum(steps, axis=2) - steps
        origin = np.zeros((count, len(self.start), 3))
        origin[:, :LINK_PATCHES] = joint.reshape(count, LINK_PATCHES, 3)
        axes = np.empty((count, len(self.start), 3, 3))
        axes[:, :LINK_PATCHES, :, 0] = ahead.reshape(count, LINK_PATCHES, 3)
        axes[:, :LINK_PATCHES, :, 1] = np.repeat(aside, LINKS_OF_FINGER, axis=1)
        axes[:, :LINK_PATCHES, :, 2] = out.reshape(count, LINK_PATCHES, 3)
        axes[:, LINK_PATCHES:] = np.eye(3)
        return Pose(origin, axes, -aside)


def part_of(patch: np.ndarray) -> np.ndarray:
    """Return the part (C,) of the hand that carries patches (C,): finger 0 to 4, or 5, the palm."""
    part: np.ndarray = np.minimum(patch // LINKS_OF_FINGER, FINGERS)
    return part


def stag_hands(*fits: Fit) -> Hands:
    """Return hands with STAG's sensors.

    Args:
        *fits: fit of each hand. Without any there is one hand of the usual size.
    """
    fits = fits or (USUAL,)
    sensors = [_stag_sensors(*fit) for fit in fits]
    row, column, patch, local, normal, area = map(np.stack, zip(*sensors, strict=True))
    scale = np.array([scale for scale, _ in fits])[:, None, None]
    return Hands(row[0], column[0], patch[0], local, normal, area, BASES * scale, LINKS * scale)


def _stag_sensors(scale: float, slip: tuple[float, float]) -> list[np.ndarray]:
    """Return row, column, patch, local, normal and area of the sensors of one hand.

    The sensors are sorted by patch. For scale and slip see `Fit`.
    """
    parts = list[tuple[np.ndarray, ...]]()
    for finger, first in enumerate((0, 6, 10, 15)):
        row, column = np.mgrid[first : first + 3, 0:14].reshape(2, -1)
        along = (13.5 - column) / 14
        parts.append((row, column, *_on_finger(finger, along, row - first - 1.0, 3, scale, slip)))
    row, column = np.mgrid[18:32, 25:29].reshape(2, -1)
    parts.append((row, column, *_on_finger(4, (row - 17.5) / 14, 26.5 - column, 4, scale, slip)))
    row, column = np.mgrid[0:18, 14:32].reshape(2, -1)
    parts.append((row, column, *_on_palm(row, column - 14, scale, slip)))
    joined = [np.concatenate(values) for values in zip(*parts, strict=True)]
    patch = joined[2]
    order = np.argsort(patch, kind="stable")
    return [values[order] for values in joined]


def _on_finger(
    finger: int,
    along: np.ndarray,
    aside: np.ndarray,
    across: int,
    scale: float,
    slip: tuple[float, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return patch, local, normal and area of a finger's n sensors.

    Args:
        finger: number of the finger, 0 to 4.
        along: (n,) place along the finger, from 0 at the base to 1 at the tip.
        aside: (n,) number of rows from the middle one.
        across: number of rows.
        scale: see `Fit`.
        slip: see `Fit`.
    """
    ends = np.cumsum(LINKS[finger]) * scale
    distance = along * ends[-1]
    link = np.searchsorted(ends[:2], distance, side="right")
    step = 2 * SIDE_TILT / (across - 1)
    tilt = aside * step
    sin = np.sin(tilt)
    cos = np.cos(tilt)
    radius = RADIUS * scale
    start = np.concatenate([[0], ends[:2]])[link]
    local = np.stack([distance - start + slip[0], radius * sin + slip[1], radius * cos], axis=1)
    normal = np.stack([np.zeros(len(link)), sin, cos], axis=1)
    area = np.full(len(link), ends[-1] / 14 * radius * step)
    return LINKS_OF_FINGER * finger + link, local, normal, area


def _on_palm(
    row: np.ndarray, column: np.ndarray, scale: float, slip: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return patch, local, normal and area of the palm's 18 x 18 sensors.

    Columns are counted from the fingers. For scale and slip see `Fit`.
    """
    length = PALM[0] * scale
    width = PALM[1] * scale
    x = (17.5 - column) / 18 * length + slip[0]
    y = (row - 8.5) / 18 * width + slip[1]
    cup = PALM_CUP * scale * (2 / width) ** 2
    normal = np.stack([np.zeros(len(y)), -2 * cup * y, np.ones(len(y))], axis=1)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    patch = LINK_PATCHES + row // TILE * (18 // TILE) + column // TILE
    local = np.stack([x, y, cup * y**2], axis=1)
    area = np.full(len(y), length * width / 18**2)
    return patch, local, normal, area


def _finger_axes(opposition: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the axes of straight fingers, (R, 5, 3) each: along, aside, and out of the skin.

    Args:
        opposition: (R,) rad, opposition of the thumbs.
    """
    along, aside, skin = np.repeat(UNOPPOSED[:, None], len(opposition), axis=1)
    cos = np.cos(opposition)
    sin = np.sin(opposition)
    along[:, THUMB, 1] = np.sin(THUMB_ANGLE) * cos
    along[:, THUMB, 2] = np.sin(THUMB_ANGLE) * sin
    aside[:, THUMB, 1] = np.cos(THUMB_ANGLE) * cos
    aside[:, THUMB, 2] = np.cos(THUMB_ANGLE) * sin
    skin[:, THUMB, 1] = -sin
    skin[:, THUMB, 2] = cos
    return along, aside, skin
