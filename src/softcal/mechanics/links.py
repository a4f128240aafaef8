"""Points that follow others: on a frame, or tied to points as their weighted sum.

    x_p = anchor_p + sum over free points m of w_m x_m + sum over frames k of (w_k c_k + R_k s_k)

A point on one frame is the case with weight one and arm s = X - c at rest. A tied point's weights come from the element
it is bonded to; masters that follow frames, or are fixed, pass the tie on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.kernel import kernel


@dataclass(frozen=True)
class Ties:
    """Points that follow others: x[point] is the sum of weight * x[master] over the entries of that point.

    Attributes
    ----------
    point, master
        Of each entry (n_entries,).
    weight
        Weight of each entry (n_entries,) [-].
    """

    point: Ints
    master: Ints
    weight: Floats


NO_TIES = Ties(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))


@dataclass(frozen=True)
class Links:
    """The links between followers, which are points, and what they follow.

    Attributes
    ----------
    followers
        The points that follow (n_followers,).
    anchor
        The constant part of their positions (n_followers, 3) [m].
    follower, master, weight
        Of each link to a free point (n_links,): the place in `followers`, the free point, and its weight [-].
    frame_follower, frame, frame_weight
        Of each link to a frame (n_frame_links,): the place in `followers`, the frame, and its weight [-].
    arm
        Arm of each link to a frame at rest (n_frame_links, 3) [m].
    """

    followers: Ints
    anchor: Floats
    follower: Ints
    master: Ints
    weight: Floats
    frame_follower: Ints
    frame: Ints
    frame_weight: Floats
    arm: Floats

    def arms(self, rotation: Floats) -> Floats:
        """The arms turned with their frames (n_frame_links, 3) [m]."""
        out = np.empty_like(self.arm)
        _turned(out, self.frame, self.arm, rotation)
        return out

    def place(self, x: Floats, position: Floats, rotation: Floats) -> None:
        """Write the followers' positions.

        Parameters
        ----------
        x
            Positions of all points (n_points, 3) [m], changed.
        position
            References of the frames (n_frames, 3) [m].
        rotation
            Their rotation matrices (n_frames, 3, 3).
        """
        if len(self.followers) == 0:
            return
        _place(
            x,
            self.followers,
            self.anchor,
            self.follower,
            self.master,
            self.weight,
            self.frame_follower,
            self.frame,
            self.frame_weight,
            self.arms(rotation),
            position,
        )


def compose(X: Floats, rider: Ints, is_free: np.ndarray, references: Floats, ties: Ties) -> Links:
    """The links of every point on a frame and every tied point.

    Parameters
    ----------
    X
        Points at rest (n_points, 3) [m].
    rider
        Frame that each point follows, or other support (n_points,), as of `Layout`.
    is_free
        Whether a point is an unknown of its own (n_points,).
    references
        References of the frames at rest (n_frames, 3) [m].
    ties
        The masters of tied points.

    Raises
    ------
    MeshError
        Where a point is tied to one that is tied itself.
    """
    tied = np.zeros(len(X), dtype=bool)
    tied[ties.point] = True
    chained = tied[ties.master]
    if chained.any():
        raise MeshError(
            Fault(
                "a node is tied to a node that is tied itself",
                got=f"{int(chained.sum())} such link(s)",
                attempt="tie the other side of one of the two contacts",
            )
        )
    riders = np.flatnonzero((rider >= 0) & ~tied)
    followers = np.concatenate([riders, np.unique(ties.point)])
    place = np.full(len(X), -1, dtype=np.int64)
    place[followers] = np.arange(len(followers))

    master_is_free = is_free[ties.master]
    on_frame = rider[ties.master] >= 0
    frame = np.concatenate([rider[riders], rider[ties.master[on_frame]]])
    weight = np.concatenate([np.ones(len(riders)), ties.weight[on_frame]])
    points = np.concatenate([riders, ties.master[on_frame]])
    arm = weight[:, None] * (X[points] - references[frame]) if len(points) else np.zeros((0, 3))
    owner = place[np.concatenate([riders, ties.point[on_frame]])]
    # Masters on one frame make one link: weights and arms add.
    n_frames = np.int64(max(len(references), 1))
    keys, inverse = np.unique(owner * n_frames + frame, return_inverse=True)
    frame_weight, arms = np.zeros(len(keys)), np.zeros((len(keys), 3))
    np.add.at(frame_weight, inverse, weight)
    np.add.at(arms, inverse, arm)

    follower = place[ties.point[master_is_free]]
    master, master_weight = ties.master[master_is_free], ties.weight[master_is_free]
    anchor = X[followers].copy()
    np.subtract.at(anchor, follower, master_weight[:, None] * X[master])
    np.subtract.at(anchor, keys // n_frames, frame_weight[:, None] * references[keys % n_frames] + arms)
    anchor[: len(riders)] = 0.0  # exactly: the remainder there is rounding error
    return Links(
        followers=followers,
        anchor=anchor,
        follower=follower,
        master=master,
        weight=master_weight,
        frame_follower=keys // n_frames,
        frame=keys % n_frames,
        frame_weight=frame_weight,
        arm=arms,
    )


@kernel(error_model="numpy")
def _turned(out: Floats, frame: Ints, arm: Floats, rotation: Floats) -> None:
    for n in range(len(frame)):
        R = rotation[frame[n]]
        for i in range(3):
            out[n, i] = R[i, 0] * arm[n, 0] + R[i, 1] * arm[n, 1] + R[i, 2] * arm[n, 2]


@kernel(error_model="numpy")
def _place(
    x: Floats,
    followers: Ints,
    anchor: Floats,
    follower: Ints,
    master: Ints,
    weight: Floats,
    frame_follower: Ints,
    frame: Ints,
    frame_weight: Floats,
    arms: Floats,
    position: Floats,
) -> None:
    for n in range(len(followers)):
        for i in range(3):
            x[followers[n], i] = anchor[n, i]
    for n in range(len(follower)):
        p = followers[follower[n]]
        for i in range(3):
            x[p, i] += weight[n] * x[master[n], i]
    for n in range(len(frame)):
        p = followers[frame_follower[n]]
        for i in range(3):
            x[p, i] += frame_weight[n] * position[frame[n], i] + arms[n, i]
