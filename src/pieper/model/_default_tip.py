"""The end of the one sensible chain in a tree, when nobody names one."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from pieper.model.joint import Joint


def sensible_tips(root: str, base: str, joints_below: Mapping[str, Sequence[Joint]]) -> list[str]:
    """The end of the one sensible chain from a link; or one end for each of the branches that are about equally long."""
    tree = _Tree(root, joints_below)
    if tree.reach[base] == 0:
        base = root  # a frame beside the arm, such as a base turned by pi: the arm hangs from the root
    return tree.tips(base)


def _is_hand(before: int, longest: int) -> bool:
    """Whether branches of at most `longest` joints behind `before` joints are the fingers of a hand."""
    return before >= 2 * longest or (before >= 4 and before >= longest)


_TOOL_NAMES = tuple(
    re.compile(rf"(?:^|[^a-z])(?:{pattern})(?:$|[^a-z])", re.IGNORECASE)
    for pattern in (
        r"tcp",
        r"tool[0-9]+",
        r"ee|eef|end[_-]?effector",
        r"grasp|gripper[_-]frame|pinch",
        r"tool",
        r"flange",
    )
)


def _tool_rank(name: str) -> tuple[int, int] | None:
    """Smaller for names that more surely mean the tool frame; None for other names."""
    for rank, pattern in enumerate(_TOOL_NAMES):
        if pattern.search(name):
            return rank, len(name)
    return None


class _Tree:
    """Where the longest ways down lead."""

    def __init__(self, root: str, joints_below: Mapping[str, Sequence[Joint]]) -> None:
        self.down = joints_below
        order = [root]  # each link behind its parent
        for link in order:
            order.extend(joint.child for joint in self.down[link])
        self.reach = dict.fromkeys(order, 0)  # moving joints on the longest way down from each link
        for link in reversed(order):
            self.reach[link] = max(map(self._weight, self.down[link]), default=0)

    def _weight(self, joint: Joint) -> int:
        """Moving joints on the longest way down that starts with `joint`."""
        return self.reach[joint.child] + (joint.type != "fixed")

    def tips(self, start: str) -> list[str]:
        """The end of the one sensible chain, or one end for each of the branches that are about equally long."""
        tips: list[str] = []
        open_starts = [(start, 0)]
        while open_starts:
            link, count = open_starts.pop()
            bodies = [(link, count)]  # rigid bodies along the trunk: their first link, and the joints before it
            while True:
                branches = sorted((j for j in self.down[link] if self._weight(j)), key=self._weight, reverse=True)
                if not branches:
                    tips.append(self._tool_frame(bodies) or self._rigid_end(bodies[-1][0]))
                    break
                longest = self._weight(branches[0])
                rivals = [joint for joint in branches if 2 * self._weight(joint) > longest]
                if len(branches) > 1 and _is_hand(count, longest):
                    tips.append(self._tool_frame(bodies) or link)
                    break
                if len(rivals) > 1:
                    open_starts.extend((j.child, count + (j.type != "fixed")) for j in reversed(rivals))
                    break
                link = branches[0].child
                if branches[0].type != "fixed":
                    count += 1
                    bodies.append((link, count))
        return tips

    def _tool_frame(self, bodies: list[tuple[str, int]]) -> str | None:
        """The leaf named as a tool frame on the last body; or a little before it, where a gripper's jaw follows."""
        end = bodies[-1][1]
        for body, count in reversed(bodies):
            beyond = end - count
            if beyond and (beyond > 2 or count <= beyond):
                return None
            ranked = sorted((rank, leaf) for leaf in self._rigid_leaves(body) if (rank := _tool_rank(leaf)) is not None)
            if len(ranked) == 1 or (ranked and ranked[0][0] != ranked[1][0]):
                return ranked[0][1]
        return None

    def _rigid_leaves(self, body: str) -> list[str]:
        """The leaves that are rigidly fixed to a link."""
        leaves, stack = [], [body]
        while stack:
            link = stack.pop()
            below = self.down[link]
            if not below and link != body:
                leaves.append(link)
            stack.extend(joint.child for joint in below if joint.type == "fixed")
        return leaves

    def _rigid_end(self, body: str) -> str:
        """Down from a link over fixed joints as long as there is one way only."""
        while len(self.down[body]) == 1:
            body = self.down[body][0].child
        return body
