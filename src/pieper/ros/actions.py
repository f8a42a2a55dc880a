"""Actions: goals that take a while, with feedback on the way, a result at the end, and a way to cancel.

ROS 2 makes an action ``NAME`` of services and topics under ``NAME/_action/``, which a bus has:

======================  =======  ==================================
``send_goal``           service  ``pkg/action/X_SendGoal``
``cancel_goal``         service  ``action_msgs/srv/CancelGoal``
``get_result``          service  ``pkg/action/X_GetResult``
``feedback``            topic    ``pkg/action/X_FeedbackMessage``
``status``              topic    ``action_msgs/msg/GoalStatusArray``
======================  =======  ==================================

References
----------
ROS 2 design, "Actions" (design.ros2.org/articles/actions.html), for the states of a goal and the rules of cancelling.
"""

from __future__ import annotations

import os
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from pieper.errors import RosError
from pieper.ros import messages
from pieper.ros.endpoints import Reply
from pieper.ros.qos import LATCHED

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pieper.ros.bus import Bus

MOST_FINISHED = 32
"""Goals that a server remembers after they have ended, so that their results can still be asked for."""

MOST_WAITING = 32
"""Requests for the result of one goal that a server keeps waiting."""


class GoalStatus(IntEnum):
    """State of a goal, ``action_msgs/msg/GoalStatus``."""

    unknown = 0
    """The server does not know such a goal, or not any more."""
    accepted = 1
    executing = 2
    canceling = 3
    succeeded = 4
    canceled = 5
    aborted = 6

    @property
    def is_final(self) -> bool:
        """True for a goal that has ended."""
        return self >= GoalStatus.succeeded

    @classmethod
    def _missing_(cls, value: object) -> GoalStatus:
        return cls.unknown  # a number that no server should send


class CancelCode(IntEnum):
    """Answer to a request to cancel, ``action_msgs/srv/CancelGoal``."""

    none = 0
    """At least one goal is being cancelled, or none was there to cancel."""
    rejected = 1
    unknown_goal = 2
    goal_terminated = 3


class Goal:
    """A goal as its server sees it.

    Attributes
    ----------
    id : bytes
        16 bytes that its client chose.
    request : message
        The fields of the goal.
    stamp : int
        When it came, by the clock of the bus [ns].
    status : GoalStatus
    """

    def __init__(self, server: ActionServer, goal_id: bytes, request: Any, stamp: int) -> None:
        self.id, self.request, self.stamp = goal_id, request, stamp
        self.status = GoalStatus.unknown
        self._server, self._waiting = server, []  # type: tuple[ActionServer, list[Reply]]
        self._result: Any = None

    @property
    def is_active(self) -> bool:
        """True from the acceptance to the end."""
        return self.status is not GoalStatus.unknown and not self.status.is_final

    def accept(self) -> None:
        """Take it on: it is executing from now on.

        Raises
        ------
        RosError
            It was accepted before, or has ended.
        """
        if self.status is not GoalStatus.unknown:
            raise RosError(f"a goal is accepted once; this one is {self.status.name}")
        self._server._goals[self.id] = self
        self._change(GoalStatus.executing)

    def feedback(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """Tell how it goes, in the fields of the action's feedback; after the end nothing is sent."""
        if self.is_active:
            self._server._send_feedback(self.id, messages.make(f"{self._server.type}_Feedback", message, **fields))

    def succeed(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """End it: done, with the fields of the action's result."""
        self._end(GoalStatus.succeeded, message, fields)

    def abort(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """End it: given up by the server."""
        self._end(GoalStatus.aborted, message, fields)

    def cancel(self, message: Mapping[str, Any] | object | None = None, /, **fields: Any) -> None:
        """End it: given up because its client asked for that.

        Raises
        ------
        RosError
            Its client did not ask for that; a message that does not fit.
        """
        if self.status is not GoalStatus.canceling:
            raise RosError(
                f"only a goal whose client asked for it is cancelled; this one is {self.status.name}: abort it"
            )
        self._end(GoalStatus.canceled, message, fields)

    def _end(self, status: GoalStatus, message: Any, fields: dict[str, Any]) -> None:
        if not self.is_active:
            raise RosError(f"only an active goal can end; this one is {self.status.name}")
        self._result = messages.make(f"{self._server.type}_Result", message, **fields)
        self._change(status)
        for reply in self._waiting:
            reply.send(self._outcome())
        self._waiting.clear()
        self._server._forget()

    def _outcome(self) -> dict[str, Any]:
        return {"status": int(self.status), "result": self._result}

    def _change(self, status: GoalStatus) -> None:
        self.status = status
        self._server._tell_status()


class ActionServer:
    """The side of an action that carries it out.

    Parameters
    ----------
    bus : Bus
    name : str
        Relative, private or absolute, as for topics; remapping it moves all five services and topics.
    type_name : str
        Such as ``"control_msgs/action/FollowJointTrajectory"``.
    on_goal : callable
        ``on_goal(goal)`` calls ``goal.accept()``, or returns the reason why it does not; it must not take long. An accepted
        goal is worked on from timers and ends by ``succeed``, ``abort`` or ``cancel``.
    on_cancel : callable, optional
        ``on_cancel(goal)`` says whether the goal will be cancelled; it may call ``goal.cancel()`` at once. Without it nothing can be
        cancelled.
    say : callable, optional
        ``say(level, text)`` for what is wrong with requests, where `Bus.log` would say too much.

    Attributes
    ----------
    name, type : str
        Full name and type.

    Examples
    --------
    >>> from pieper.ros.fake import FakeNetwork
    >>> network = FakeNetwork()
    >>> arm, user = network.bus("arm"), network.bus("user")
    >>> def follow(goal):
    ...     goal.accept()
    ...     goal.succeed(error_string="there")
    >>> FOLLOW = "control_msgs/action/FollowJointTrajectory"
    >>> server = ActionServer(arm, "follow", FOLLOW, on_goal=follow)
    >>> goal = ActionClient(user, "follow", FOLLOW).run({}, timeout=1.0)
    >>> goal.status.name, goal.result.error_string
    ('succeeded', 'there')
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        type_name: str,
        *,
        on_goal: Callable[[Goal], str | None],
        on_cancel: Callable[[Goal], bool] | None = None,
        say: Callable[[str, str], None] | None = None,
    ) -> None:
        self.name, self.type = bus.resolve(name), type_name
        self._bus, self._on_goal, self._on_cancel = bus, on_goal, on_cancel
        self._say = say or bus.log
        self._goals: dict[bytes, Goal] = {}
        hidden = f"{self.name}/_action"
        self._feedback = bus.publisher(f"{hidden}/feedback", f"{type_name}_FeedbackMessage")
        self._status = bus.publisher(f"{hidden}/status", "action_msgs/msg/GoalStatusArray", qos=LATCHED)
        self._services = [
            bus.serve(f"{hidden}/send_goal", f"{type_name}_SendGoal", self._accept),
            bus.serve(f"{hidden}/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel),
            bus.serve(f"{hidden}/get_result", f"{type_name}_GetResult", self._get_result),
        ]

    @property
    def goals(self) -> list[Goal]:
        """Goals that are active now, oldest first."""
        return [goal for goal in self._goals.values() if goal.is_active]

    def close(self) -> None:
        """Leave the network."""
        for service in self._services:
            service.close()
        self._feedback.close()
        self._status.close()

    def _accept(self, request: Any) -> dict[str, Any]:
        goal = Goal(self, _id(request.goal_id), request.goal, self._bus.now())
        reason: str | None = "its id is that of a goal that was sent before"
        if goal.id not in self._goals:
            try:
                reason = self._on_goal(goal)
            except Exception:
                if goal.is_active:
                    goal.abort()
                raise
        accepted = goal.status is not GoalStatus.unknown
        if not accepted:
            self._say("warn", f"{self.name}: goal rejected: {reason or 'the server gives no reason'}")
        return {"accepted": accepted, "stamp": _time(goal.stamp)}

    def _cancel(self, request: Any) -> dict[str, Any]:
        wanted, code = self._chosen(_id(request.goal_info.goal_id), _nanoseconds(request.goal_info.stamp))
        canceling = [goal for goal in wanted if goal.status is GoalStatus.canceling or self._may_cancel(goal)]
        if wanted and not canceling:
            code = CancelCode.rejected
        infos = [_info(goal) for goal in canceling]
        return {"return_code": int(code), "goals_canceling": infos}

    def _chosen(self, goal_id: bytes, before: int) -> tuple[list[Goal], CancelCode]:
        """The goals that a request to cancel means: by id, by time, or all."""
        if not any(goal_id):
            return [goal for goal in self.goals if before == 0 or goal.stamp <= before], CancelCode.none
        chosen = [goal for goal in self.goals if goal.id == goal_id or (before and goal.stamp <= before)]
        if chosen:
            return chosen, CancelCode.none
        return [], CancelCode.goal_terminated if goal_id in self._goals else CancelCode.unknown_goal

    def _may_cancel(self, goal: Goal) -> bool:
        if self._on_cancel is None:
            return False
        before = goal.status
        goal._change(GoalStatus.canceling)
        may = False
        try:
            may = self._on_cancel(goal)
        finally:
            if not may and goal.status is GoalStatus.canceling:
                goal._change(before)
        return may

    def _get_result(self, request: Any) -> Reply | dict[str, Any]:
        goal = self._goals.get(_id(request.goal_id))
        if goal is None:
            return {"status": int(GoalStatus.unknown)}
        if goal.status.is_final:
            return goal._outcome()
        if len(goal._waiting) >= MOST_WAITING:
            self._say("warn", f"{self.name}: {MOST_WAITING} requests wait for the result of one goal; no more are kept")
            return {"status": int(GoalStatus.unknown)}
        goal._waiting.append(Reply())
        return goal._waiting[-1]

    def _send_feedback(self, goal_id: bytes, feedback: Any) -> None:
        self._feedback.send(goal_id={"uuid": goal_id}, feedback=feedback)

    def _tell_status(self) -> None:
        self._status.send(
            status_list=[{"goal_info": _info(goal), "status": int(goal.status)} for goal in self._goals.values()]
        )

    def _forget(self) -> None:
        """Forget the goals that ended longest ago."""
        finished = [goal for goal in self._goals.values() if goal.status.is_final]
        for goal in finished[:-MOST_FINISHED]:
            del self._goals[goal.id]


class SentGoal:
    """A goal as its client sees it; made by :meth:`ActionClient.send`.

    Attributes
    ----------
    id : bytes
        Its 16 bytes.
    accepted : bool or None
        What the server said; None until it has.
    status : GoalStatus
        ``unknown`` until it is accepted, and where it is not; then ``executing`` until the result is here.
    result : message or None
        The fields of the result, once it is here.
    """

    def __init__(self, client: ActionClient, goal_id: bytes) -> None:
        self.id, self.accepted, self.status = goal_id, None, GoalStatus.unknown  # type: tuple[bytes, bool | None, GoalStatus]
        self.result: Any = None
        self._client, self._done = client, False
        self._on_feedback: Callable[[Any], Any] | None = None
        self._on_done: Callable[[SentGoal], Any] | None = None

    @property
    def done(self) -> bool:
        """True when it was rejected or its result is here."""
        return self._done

    def cancel(self, on_reply: Callable[[CancelCode], Any] | None = None) -> None:
        """Ask the server to cancel it; ``on_reply(code)`` tells what it said, and the end comes as a result all the same."""
        self._client._cancel.send(
            lambda reply: on_reply(CancelCode(int(reply.return_code))) if on_reply else None,
            goal_info={"goal_id": {"uuid": self.id}},
        )

    def _end(self, status: GoalStatus, result: Any) -> None:
        self.status, self.result, self._done = status, result, True
        self._client._goals.pop(self.id, None)
        if self._on_done is not None:
            self._on_done(self)


class ActionClient:
    """The side of an action that asks for it.

    Parameters
    ----------
    bus : Bus
    name, type_name : str
        As for :class:`ActionServer`.
    """

    def __init__(self, bus: Bus, name: str, type_name: str) -> None:
        self.name, self.type = bus.resolve(name), type_name
        self._bus = bus
        self._goals: dict[bytes, SentGoal] = {}
        hidden = f"{self.name}/_action"
        self._send = bus.client(f"{hidden}/send_goal", f"{type_name}_SendGoal")
        self._cancel = bus.client(f"{hidden}/cancel_goal", "action_msgs/srv/CancelGoal")
        self._get_result = bus.client(f"{hidden}/get_result", f"{type_name}_GetResult")
        self._feedback = bus.subscribe(f"{hidden}/feedback", f"{type_name}_FeedbackMessage", self._on_feedback)

    @property
    def ready(self) -> bool:
        """Whether a server is there now."""
        services = (self._send, self._cancel, self._get_result)
        return all(service.ready for service in services) and self._feedback.publishers > 0

    def send(
        self,
        goal: Mapping[str, Any] | object,
        *,
        on_feedback: Callable[[Any], Any] | None = None,
        on_done: Callable[[SentGoal], Any] | None = None,
    ) -> SentGoal:
        """Send a goal, given by its fields; what becomes of it comes from the spin.

        Parameters
        ----------
        goal : mapping or message
        on_feedback : callable, optional
            ``on_feedback(feedback)``.
        on_done : callable, optional
            ``on_done(goal)``, once: when it was rejected, or with its result.

        Returns
        -------
        SentGoal
            Whose state follows what the server says.

        Raises
        ------
        RosError
            A field is unknown to the goal, or a value does not fit.
        """
        sent = SentGoal(self, os.urandom(16))
        sent._on_feedback, sent._on_done = on_feedback, on_done
        self._send.send(lambda reply: self._on_accepted(sent, reply), goal_id={"uuid": sent.id}, goal=goal)
        self._goals[sent.id] = sent
        return sent

    def run(
        self,
        goal: Mapping[str, Any] | object,
        *,
        timeout: float,
        on_feedback: Callable[[Any], Any] | None = None,
    ) -> SentGoal:
        """Wait for the server, send a goal, and spin until it has ended. Not from inside a callback.

        Parameters
        ----------
        goal : mapping or message
        timeout : float
            Seconds to wait for the server, and again for the end.
        on_feedback : callable, optional
            ``on_feedback(feedback)``.

        Returns
        -------
        SentGoal
            Rejected, or ended with a result.

        Raises
        ------
        TimeoutError
            No server, or no end in time; then the server is asked to cancel the goal.
        """
        if not self._bus.spin_until(lambda: self.ready, timeout=timeout):
            raise TimeoutError(f"no server for the action {self.name} ({self.type}) within {timeout:g} s")
        sent = self.send(goal, on_feedback=on_feedback)
        if not self._bus.spin_until(lambda: sent.done, timeout=timeout):
            sent.cancel()
            raise TimeoutError(
                f"the goal that was sent to {self.name} has not ended within {timeout:g} s; it is cancelled"
            )
        return sent

    def close(self) -> None:
        """Leave the network; goals go on without this client."""
        for service in (self._send, self._cancel, self._get_result):
            service.close()
        self._feedback.close()

    def _on_accepted(self, goal: SentGoal, reply: Any) -> None:
        goal.accepted = bool(reply.accepted)
        if not goal.accepted:
            goal._end(GoalStatus.unknown, None)
            return
        goal.status = GoalStatus.executing
        self._get_result.send(
            lambda reply: goal._end(GoalStatus(int(reply.status)), reply.result), goal_id={"uuid": goal.id}
        )

    def _on_feedback(self, message: Any) -> None:
        goal = self._goals.get(_id(message.goal_id))
        if goal is not None and goal._on_feedback is not None:
            goal._on_feedback(message.feedback)


def _id(message: Any) -> bytes:
    return bytes(bytearray(message.uuid))


def _info(goal: Goal) -> dict[str, Any]:
    return {"goal_id": {"uuid": goal.id}, "stamp": _time(goal.stamp)}


def _time(nanoseconds: int) -> dict[str, int]:
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nanosec": rest}


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
