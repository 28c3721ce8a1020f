"""Find the members by their names in `model.members` of params.yaml."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tactile_viewgcn.members.convolutions import ConvolutionsMember
from tactile_viewgcn.members.kernel import KernelMember
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.network import NETWORK, NetworkMember
from tactile_viewgcn.members.pooled_kernel import PooledKernelMember
from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.members.svm import SvmMember
from tactile_viewgcn.members.trees import TreesMember

if TYPE_CHECKING:
    from tactile_viewgcn.nn.network import ViewNetwork

#: All members except the network, which is built around a network of nn/.
ON_SENSORS: dict[str, type[Member]] = {
    member.name: member
    for member in (TreesMember, SvmMember, ConvolutionsMember, KernelMember, PooledKernelMember)
}


def build_members(
    names: Sequence[str],
    representation: Representation,
    classes: int,
    *,
    network: "ViewNetwork | None" = None,
) -> list[Member]:
    """Return the members of these names, which are not fitted yet.

    Args:
        names: names from `model.members`.
        representation: scales counts to readings.
        classes: number of classes.
        network: the network of the member `network`, or None.
    """
    members = []
    for name in names:
        member: Member
        if name == NETWORK:
            member = NetworkMember(representation, classes, network=network)
        else:
            member = ON_SENSORS[name](representation, classes)
        members.append(member)
    return members


def answering_sets(
    members: Sequence[Member], representation: Representation, classes: int
) -> list[Member]:
    """Return the members that answer view sets, or a new `svm` if none of them does.

    Args:
        members: the members of a classifier.
        representation: scales counts to readings.
        classes: number of classes.
    """
    answering = [member for member in members if member.answers_sets]
    if answering:
        return answering
    return [SvmMember(representation, classes)]
