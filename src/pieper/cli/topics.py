"""``pieper ros pub``, ``echo`` and ``call``: what ``ros2 topic`` and ``ros2 service`` do, where there is no ROS 2."""

from __future__ import annotations

import os
import re
import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pieper.cli import completion
from pieper.cli.node import Backend, Domain, Network, joined, ros_arguments
from pieper.errors import MissingExtraError, RosError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pieper.ros.qos import QoS

_TYPE = re.compile(r"[a-z]\w*(?:/(?:msg|srv))?/[A-Z]\w*")
_EXPONENT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+")
_TO_BE_SENT = 0.2  # seconds that a last message is given to leave

TopicName = Annotated[str, typer.Argument(metavar="TOPIC", help="For example /target.")]
Quality = Annotated[
    str | None,
    typer.Option(
        "--qos",
        metavar="NAME",
        help="default, latched or sensor; by itself what the topic usually has.",
        autocompletion=completion.qualities,
    ),
]


def pub(
    context: typer.Context,
    topic: TopicName,
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TYPE] [FIELDS]", help="As geometry_msgs/msg/Point '{x: 0.3, y: 0.3, z: 0.3}'."),
    ] = None,
    once: Annotated[bool, typer.Option("--once", "-1", help="Leave after the first message.")] = False,
    times: Annotated[int | None, typer.Option("--times", "-t", metavar="N", help="Leave after N messages.")] = None,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="How many a second; messages.")] = 1.0,
    timeout: Annotated[
        float,
        typer.Option(
            "--timeout", metavar="SECONDS", help="How long at most; for a subscriber, with --once and --times."
        ),
    ] = 10.0,
    quality: Quality = None,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> int:
    r"""Send a message to a topic, again and again.

    For example:
      pieper ros pub /target geometry_msgs/msg/Point \
          '{x: 0.3, y: 0.3, z: 0.3}' --once
    """
    type_name, fields = _type_and_fields(topic, words or [])
    count = 1 if once else times
    if count is not None and count < 1:
        raise RosError(f"--times takes a count from 1 on, got {count}")
    if not 0.0 < rate < float("inf"):
        raise RosError(f"--rate takes a positive number of messages per second, got {rate}")
    from pieper.ros import messages

    message = messages.make(type_name, fields)
    sent = 0
    with joined(
        _name("pub"), arguments=_quiet(ros_arguments(context)), backend=backend, network=network, domain=domain
    ) as bus:
        publisher = bus.publisher(topic, type_name, qos=_quality(quality, topic))

        def send() -> None:
            nonlocal sent
            if count is None or sent < count:
                publisher.send(message)
                sent += 1

        if count is not None and not bus.spin_until(lambda: publisher.subscribers > 0, timeout=timeout):
            if bus.ok:
                return _nobody(f"nobody listens to {publisher.topic} ({type_name}); waited {timeout:g} s")
            return 0
        send()
        bus.timer(1.0 / rate, send)
        bus.spin_until(lambda: count is not None and sent >= count)
        bus.spin_until(lambda: False, timeout=_TO_BE_SENT)
    return 0


def echo(
    context: typer.Context,
    topic: TopicName,
    type_name: Annotated[
        str | None, typer.Argument(metavar="[TYPE]", help="As sensor_msgs/msg/JointState; needless for usual names.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", "-1", help="Leave after the first message.")] = False,
    times: Annotated[int | None, typer.Option("--times", "-t", metavar="N", help="Leave after N messages.")] = None,
    timeout: Annotated[
        float | None,
        typer.Option("--timeout", metavar="SECONDS", help="How long at most; exit code 1 if nothing came."),
    ] = None,
    field: Annotated[
        str | None, typer.Option("--field", metavar="NAME", help="Print one field only, such as header.stamp.")
    ] = None,
    quality: Quality = None,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> int:
    """Print the messages of a topic as YAML.

    For example:
      pieper ros echo /joint_states --once
    """
    from pieper.ros import messages

    name, _ = _type_and_fields(topic, [type_name] if type_name else [])
    path = _field_path(name, field)
    wanted = 1 if once else times
    if wanted is not None and wanted < 1:
        raise RosError(f"--times takes a count from 1 on, got {wanted}")
    dump = _dumper()
    heard: list[Any] = []
    printed = 0

    def enough() -> bool:
        """Print what was heard; here, since what goes wrong in a callback only goes to the log."""
        nonlocal printed
        for message in heard[: None if wanted is None else wanted - printed]:
            part = message
            for step in path:
                part = getattr(part, step)
            sys.stdout.write(dump(messages.as_fields(part)) + "---\n")
            sys.stdout.flush()
            printed += 1
        heard.clear()
        return printed == wanted

    with joined(
        _name("echo"), arguments=_quiet(ros_arguments(context)), backend=backend, network=network, domain=domain
    ) as bus:
        subscription = bus.subscribe(topic, name, heard.append, qos=_quality(quality, topic, hear_all=True))
        try:
            complete = bus.spin_until(enough, timeout=timeout)
        except BrokenPipeError:  # the reader of a pipe has seen enough, as `| head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        if bus.ok and not complete and (wanted is not None or not printed):
            count_heard = f"{printed or 'no'} message{'' if printed == 1 else 's'}"
            return _nobody(f"{count_heard} on {subscription.topic} within {timeout:g} s")
    return 0


def call(
    context: typer.Context,
    service: Annotated[str, typer.Argument(metavar="SERVICE", help="For example /quat2zyx.")],
    type_name: Annotated[str, typer.Argument(metavar="TYPE", help="As pieper_interfaces/srv/QuatToZYX.")],
    fields: Annotated[
        str | None, typer.Argument(metavar="[FIELDS]", help="Of the request, as '{q: {z: 0.7, w: 0.7}}'.")
    ] = None,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", help="How long at most; for the server and its answer.")
    ] = 10.0,
    backend: Backend = None,
    network: Network = False,
    domain: Domain = None,
) -> int:
    r"""Call a service, and print its answer as YAML.

    For example:
      pieper ros call /quat2zyx pieper_interfaces/srv/QuatToZYX \
          '{q: {z: 0.7, w: 0.7}}'
    """
    from pieper.ros import messages

    if not _TYPE.fullmatch(type_name):
        raise RosError(f"{type_name!r} is not the type of a service, as pieper_interfaces/srv/QuatToZYX")
    full = _full_type(type_name, "srv")
    request = messages.make(f"{full}_Request", read_fields(fields or "{}"))
    with joined(
        _name("call"), arguments=_quiet(ros_arguments(context)), backend=backend, network=network, domain=domain
    ) as bus:
        try:
            answer = bus.call(bus.client(service, full), timeout, request)
        except TimeoutError as error:
            return _nobody(str(error)) if bus.ok else 0
    sys.stdout.write(_dumper()(messages.as_fields(answer)))
    return 0


def read_fields(text: str) -> dict[str, Any]:
    """Read the fields of a message from YAML; ``1e-3`` is a number too, as in YAML 1.2.

    Raises
    ------
    RosError
        It is not YAML, or not a mapping.

    Examples
    --------
    >>> read_fields("{x: 1e-3, header: {frame_id: base_link}}")
    {'x': 0.001, 'header': {'frame_id': 'base_link'}}
    """
    yaml = _yaml()
    loader: Any = type("Loader", (yaml.SafeLoader,), {})
    loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("+-.0123456789"))
    try:
        fields = yaml.load(text, loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise RosError(f"{text!r:.80} is not YAML: {error}") from error
    if fields is None:
        return {}
    if not isinstance(fields, dict) or not all(isinstance(name, str) for name in fields):
        raise RosError(f"the fields of a message are written '{{name: value, ...}}', got {text!r:.80}")
    return fields


def _type_and_fields(topic: str, words: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """The type that was typed, or the usual one of the topic; and the fields."""
    from pieper.ros.topics import Topic

    rest = list(words)
    typed = rest.pop(0) if rest and _TYPE.fullmatch(rest[0]) else ""
    if len(rest) > 1:
        raise RosError(f"expected a type and then all fields in one word, as '{{x: 0.3, y: 0.3}}', got {rest!r}")
    if not typed and rest and not rest[0].lstrip().startswith("{"):
        raise RosError(f"{rest[0]!r} is neither a type, as geometry_msgs/msg/Point, nor fields, as '{{x: 0.3}}'")
    name = _full_type(typed, "msg") if typed else Topic.parse(topic).type
    return name, read_fields(rest[0]) if rest else {}


def _full_type(name: str, kind: str) -> str:
    """The name with its middle part, which may be left out: ``std_msgs/String``."""
    return name if name.count("/") != 1 else name.replace("/", f"/{kind}/")


def _field_path(type_name: str, field: str | None) -> list[str]:
    from pieper.ros import messages

    message, path = messages.make(type_name), field.split(".") if field else []
    for k, part in enumerate(path):
        fields = messages.as_fields(message)
        if not isinstance(fields, dict) or part not in fields:
            known = ", ".join(fields) if isinstance(fields, dict) else "none"
            raise RosError(f"{'.'.join([type_name, *path[:k]])} has no field {part!r}; its fields are: {known}")
        message = getattr(message, part)
    return path


def _quality(name: str | None, topic: str, *, hear_all: bool = False) -> QoS:
    from pieper.ros.qos import DEFAULT, QoS
    from pieper.ros.topics import QUALITIES, usual

    if name is not None:
        if name not in QUALITIES:
            raise RosError(f"no quality of service {name!r}; there are: {', '.join(QUALITIES)}")
        return QUALITIES[name]
    known = usual(topic)
    if known is not None:
        return known[1]
    return QoS(reliable=False) if hear_all else DEFAULT  # a best-effort subscriber hears every publisher


def _yaml() -> Any:
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError("pyyaml", "ros", "reading and printing messages") from error
    return yaml


def _dumper() -> Any:
    yaml = _yaml()

    def dump(fields: Any) -> str:
        text = str(yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=10**9))
        return text.removesuffix("...\n")  # what YAML writes behind a single value

    return dump


def _name(verb: str) -> str:
    return f"_pieper_{verb}_{os.getpid()}"  # hidden from `ros2 node list`, as those of the ros2 command are


def _quiet(arguments: list[str]) -> list[str]:
    return ["--ros-args", "--log-level", "warn", "--", *arguments]


def _nobody(sentence: str) -> int:
    typer.secho(f"pieper: {sentence}", err=True, fg=typer.colors.RED)
    return 1
