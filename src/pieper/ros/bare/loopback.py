"""Who may reach this process: its DDS sockets on the loopback interface alone, or on the network.

Cyclone DDS can be told to use only ``lo``, and then sends only there, but it still *receives* on ``0.0.0.0``: whoever reaches
the machine reaches the robot, and DDS without its security plugins asks nobody for a password. So `open_domain` also ties
every socket that Cyclone opened to the device ``lo`` (``SO_BINDTODEVICE``), which the kernel holds to. Where that cannot be
had, nothing is opened. Only who asks for the network gets it.

The sockets belong to the domain, not to the participant: they are there when `open_domain` returns, and all participants
of one process in one domain share them.
"""

from __future__ import annotations

import atexit
import ctypes
import ipaddress
import os
import socket
import stat
import sys
import threading
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

from cyclonedds.core import DDSException, Entity
from cyclonedds.domain import Domain
from cyclonedds.internal import DDS

from pieper.errors import RosError

if TYPE_CHECKING:
    from collections.abc import Iterable

LOOPBACK = "lo"
LAST_DOMAIN = 232
"""The last domain whose ports (7400 + 250 domain ...) are below 65536."""

LAST_INDEX = 119
"""The last participant index whose ports (7410 + 250 domain + 2 index, and one more) are not those of the next domain."""

LARGEST_SAMPLE = 64 * 1024 * 1024
"""Bytes of the largest message that is put together from fragments; a larger claim is dropped before memory is taken."""

ANNOUNCED = 3
"""Seconds from one announcement of a participant on loopback to the next. Left to itself, Cyclone announces a participant only
when it starts to addresses where it knows nobody: what is lost then is lost for good, and so is who does not ask back."""

SO_BINDTODEVICE = 25
"""Of Linux; the module `socket` names it only where it was built with it."""

_FATAL, _ERROR, _WARNING = 1, 2, 4
"""Categories of Cyclone's messages (``DDS_LC_...``)."""

_open: weakref.WeakValueDictionary[int, Domain] = weakref.WeakValueDictionary()
_on_network: dict[int, bool] = {}
_receivers: dict[int, set[int]] = {}
"""Inodes of the sockets of each domain; a closed domain's may live on in a duplicate that somebody still holds."""

_lock = threading.RLock()


def configuration(domain: int = 0, *, network: bool = False) -> str:
    """Write the Cyclone DDS configuration for this machine alone, or for the network.

    Parameters
    ----------
    domain : int
        ``ROS_DOMAIN_ID``; only the number of participants depends on it, and only in the last domain.
    network : bool
        False: the loopback interface, no multicast, participants found by asking each port of 127.0.0.1.
        True: what ``CYCLONEDDS_URI`` says, and if it is not set, Cyclone's own choice of interface, with multicast.

    Returns
    -------
    str
        For ``cyclonedds.domain.Domain(domain, ...)``. Nothing is written to the environment, so participants that the user
        makes in other domains keep their own settings; and on loopback nothing is read from it.

    Notes
    -----
    `LAST_INDEX` + 1 processes fit into one loopback domain. ROS nodes with ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` ask
    only the first 33, but answer whoever asks them, which each process here does every `ANNOUNCED` seconds.
    """
    limits = f"<Internal><MaxSampleSize>{LARGEST_SAMPLE}B</MaxSampleSize></Internal>"
    if network:
        own = os.environ.get("CYCLONEDDS_URI", "").strip()
        return own or f'<CycloneDDS><Domain Id="any">{limits}</Domain></CycloneDDS>'
    return (
        '<CycloneDDS><Domain Id="any">'
        f'<General><Interfaces><NetworkInterface name="{escape(LOOPBACK)}"/></Interfaces>'
        "<AllowMulticast>false</AllowMulticast></General>"
        f"<Discovery><SPDPInterval>{ANNOUNCED}s</SPDPInterval><ParticipantIndex>auto</ParticipantIndex>"
        f"<MaxAutoParticipantIndex>{_last_index(domain)}</MaxAutoParticipantIndex>"
        '<Peers><Peer Address="127.0.0.1"/></Peers></Discovery>'
        f"{limits}</Domain></CycloneDDS>"
    )


def open_domain(domain: int = 0, *, network: bool = False) -> Domain:
    """Open a DDS domain whose sockets nobody outside this machine can reach, or, when asked for, on the network.

    Parameters
    ----------
    domain : int
        ``ROS_DOMAIN_ID``, 0 ... 232.
    network : bool
        Leave this machine. DDS has no authentication: whoever is on that network can then command the node.

    Returns
    -------
    cyclonedds.domain.Domain
        Keep it as long as its participants: they end with it. A second call in the same process returns the same one.

    Raises
    ------
    RosError
        A domain out of range; no such network interface; no free participant index; a domain that this process has
        opened with other settings; sockets that cannot be kept to the loopback interface. Nothing stays open then.

    Notes
    -----
    Between the opening of a socket and its tying down lies about a millisecond in which it receives from everywhere.

    Cyclone's threads write a warning to stderr for every datagram they cannot read, and when nobody reads that stderr (a pipe
    that is full, a stopped terminal) they wait, and the node is deaf until it is ended. So after opening, Cyclone's
    messages are off in this process, except fatal ones; a ``Tracing`` element in ``CYCLONEDDS_URI`` still writes them to its file.
    """
    if not 0 <= domain <= LAST_DOMAIN:
        raise RosError(f"ROS_DOMAIN_ID must be 0 ... {LAST_DOMAIN}, got {domain}: its UDP ports would not exist")
    if not network and sys.platform != "linux":
        raise RosError(
            f"on {sys.platform} the DDS sockets cannot be kept to the loopback interface: "
            "use --network if everyone on the network may command this node, or the rclpy or fake backend"
        )
    with _lock:
        shared = _open.get(domain)
        if shared is not None:
            if _on_network[domain] == network:
                return shared
            here, asked = ("network", "loopback") if _on_network[domain] else ("loopback", "network")
            raise RosError(
                f"this process has domain {domain} open on the {here} and is now asked for it on the {asked}: "
                "use the same choice, or another ROS_DOMAIN_ID"
            )
        before = _inodes(domain) if network else {s.inode for s in sockets()}
        _log(_FATAL | _ERROR | _WARNING)  # the cause of a failure now is worth a line
        try:
            opened = Domain(domain, configuration(domain, network=network))
        except (DDSException, UnicodeEncodeError) as error:
            raise RosError(explain(error, domain=domain, network=network)) from error
        silence()
        if not network:
            try:
                pin_to_loopback(domain, known=before)
            except RosError:
                close_domain(opened)
                raise
        _receivers[domain] = _inodes(domain) - before
        _open[domain] = opened
        _on_network[domain] = network
        return opened


def close_domain(domain: Domain, *, timeout: float = 5.0) -> None:
    """Close a domain at once, with its sockets and every participant in it, whoever still holds them.

    Parameters
    ----------
    domain : cyclonedds.domain.Domain
        From `open_domain`. Closing it twice is no error.
    timeout : float
        How long Cyclone's threads may take to end [s]; usually it is milliseconds.

    Raises
    ------
    RosError
        They did not end: one of them stands still. The domain cannot be opened again in this process; let the error end it.
        Its exit code is then 1.
    """
    with _lock:
        for number, other in list(_open.items()):
            if other is domain:
                del _open[number]
    # deletes the C entity and all its children; the second call, by the collector, does nothing
    closing = threading.Thread(target=domain.__del__, name="close DDS domain", daemon=True)
    closing.start()
    closing.join(timeout)
    if closing.is_alive():
        # whoever deletes an entity now waits too, and so does the interpreter at its end
        Entity._entities.clear()
        atexit.register(_leave)
        raise RosError(
            f"the threads of DDS did not end within {timeout:g} s, so this process cannot be heard or hear again: start it anew"
        )


def _leave() -> None:
    """End this process without waiting for the threads of DDS."""
    for stream in (sys.stdout, sys.stderr):
        # nobody may be reading: then the rest of what was printed is not worth waiting for
        flushing = threading.Thread(target=stream.flush, daemon=True)
        flushing.start()
        flushing.join(1.0)
    os._exit(1)


def is_open(domain: Domain, number: int) -> bool:
    """Whether a domain from `open_domain` has not been closed since, by whomever."""
    with _lock:
        return _open.get(number) is domain


def silence() -> None:
    """Keep Cyclone's threads from writing to stderr, where they could wait for ever; fatal messages remain."""
    _log(_FATAL)


def _log(categories: int) -> None:
    """Choose the categories of messages that Cyclone writes to stderr: one setting for the whole process."""
    DDS._dll_handle.dds_set_log_mask(ctypes.c_uint32(categories))


@dataclass(frozen=True)
class UdpSocket:
    """A UDP socket of this process.

    Attributes
    ----------
    fd : int
        File descriptor; the first, where there are several.
    inode : int
        Its number in ``/proc/net/udp``.
    address, port : str, int
        What it is bound to.
    device : str
        The interface it is tied to (``SO_BINDTODEVICE``), or empty.
    """

    fd: int
    inode: int
    address: str
    port: int
    device: str

    @property
    def bound(self) -> bool:
        """Whether it receives at all."""
        return self.port != 0

    @property
    def reachable(self) -> bool:
        """Whether another machine could send to it: bound, and neither address nor device is loopback."""
        return self.bound and self.device != LOOPBACK and not ipaddress.ip_address(self.address).is_loopback


def sockets() -> list[UdpSocket]:
    """List the UDP sockets of this process, those of Cyclone among them.

    Raises
    ------
    RosError
        Where ``/proc/self/fd`` cannot be read: not Linux, or a sandbox without it.
    """
    found: list[UdpSocket] = []
    try:
        names = [int(p.name) for p in Path("/proc/self/fd").iterdir()]
    except OSError as error:
        raise RosError(
            f"cannot list this process' sockets in /proc/self/fd ({error}), so cannot keep them to the loopback interface: "
            "mount /proc, or use --network if everyone on the network may command this node"
        ) from error
    for fd in sorted(names):
        try:
            status = os.fstat(fd)
            if not stat.S_ISSOCK(status.st_mode) or any(one.inode == status.st_ino for one in found):
                continue
            with socket.socket(fileno=os.dup(fd)) as copy:
                if copy.family not in (socket.AF_INET, socket.AF_INET6) or copy.type != socket.SOCK_DGRAM:
                    continue
                address, port = copy.getsockname()[:2]
                device = copy.getsockopt(socket.SOL_SOCKET, SO_BINDTODEVICE, 16).rstrip(b"\0").decode()
        except OSError:  # closed since it was listed
            continue
        found.append(UdpSocket(fd, status.st_ino, address.partition("%")[0], port, device))
    return found


def receivers(domain: int) -> list[UdpSocket]:
    """List the sockets at which this process receives for a domain; empty where sockets cannot be listed."""
    try:
        known = [s for s in sockets() if s.inode in _receivers.get(domain, ())]
    except RosError:
        return []
    # the socket that sends has any port, at the address of its interface
    return [s for s in known if _of_domain(s, domain) and ipaddress.ip_address(s.address).is_unspecified]


def duplicate(one: UdpSocket) -> socket.socket:
    """Return a second descriptor of a socket, to look at it; close it before the domain."""
    return socket.socket(fileno=os.dup(one.fd))


def pin_to_loopback(domain: int, *, known: Iterable[int] = ()) -> list[UdpSocket]:
    """Tie the sockets of a DDS domain to the loopback interface, so that the kernel drops what comes from elsewhere.

    Parameters
    ----------
    domain : int
        Only sockets with the ports of this domain, and those at a loopback address, are touched.
    known : iterable of int
        Inodes of sockets that were there before the domain was opened, which are somebody else's.

    Returns
    -------
    list of UdpSocket
        The sockets, as they are now.

    Raises
    ------
    RosError
        Where the kernel does not permit it (Linux before 5.7 without CAP_NET_RAW), or a socket stays reachable.
    """
    others = set(known)
    mine = [s for s in sockets() if s.inode not in others and s.bound and _of_domain(s, domain)]
    try:
        for one in mine:
            with socket.socket(fileno=os.dup(one.fd)) as copy:
                copy.setsockopt(socket.SOL_SOCKET, SO_BINDTODEVICE, LOOPBACK.encode() + b"\0")
    except OSError as error:
        raise RosError(
            f"cannot tie the DDS sockets of domain {domain} to the loopback interface ({error.strerror}): "
            "this needs Linux 5.7 or CAP_NET_RAW; use --network if everyone on the network may command this node"
        ) from error
    inodes = {s.inode for s in mine}
    now = [s for s in sockets() if s.inode in inodes]
    left = [s for s in now if s.reachable]
    if left or not now:
        what = ", ".join(f"{s.address}:{s.port}" for s in left) or "no socket of this domain found"
        raise RosError(
            f"DDS sockets are not kept to the loopback interface: {what}; "
            "use --network if everyone on the network may command this node"
        )
    return now


def explain(error: Exception, *, domain: int, network: bool) -> str:
    """Turn an error of Cyclone DDS at opening into a sentence: what was expected, what came, what to do.

    Cyclone has one code for nearly everything and prints the cause to stderr, so the causes are looked for here.
    """
    if isinstance(error, UnicodeEncodeError):
        return "CYCLONEDDS_URI has characters that are not ASCII, which cyclonedds cannot take: move the file to another path"
    if getattr(error, "code", None) == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
        return (
            f"something else in this process has opened DDS domain {domain} with its own settings: "
            "open the bus first, or use another ROS_DOMAIN_ID"
        )
    if not network:
        if not _is_up(LOOPBACK):
            return f"the network interface {LOOPBACK!r} is missing or down: bring it up (ip link set {LOOPBACK} up)"
        ports = [_port(domain, index) for index in range(_last_index(domain) + 1)]
        taken = sum(not (_free(port) and _free(port + 1)) for port in ports)
        if taken == len(ports):
            return (
                f"domain {domain} is full: all {taken} participant indices on this machine are in use; "
                "end some nodes, or use another ROS_DOMAIN_ID"
            )
    elif os.environ.get("CYCLONEDDS_URI", "").strip():
        return (
            f"Cyclone DDS could not open domain {domain} with the settings in CYCLONEDDS_URI ({error}): "
            "its own message on stderr tells the element; correct or unset CYCLONEDDS_URI"
        )
    else:
        up = [name for _, name in socket.if_nameindex() if name != LOOPBACK and _is_up(name)]
        if not up:
            return "no network interface is up besides the loopback: connect one, or leave out --network"
    return f"Cyclone DDS could not open domain {domain} ({error}): its own message on stderr tells why"


def _inodes(domain: int) -> set[int]:
    """Sockets with a port of the domain; none where sockets cannot be listed."""
    try:
        return {s.inode for s in sockets() if _of_domain(s, domain)}
    except RosError:
        return set()


def _port(domain: int, index: int) -> int:
    """Port of discovery traffic of a participant [RTPS 2.5, section 9.6.2.3]; user traffic has the next one."""
    return 7400 + 250 * domain + 10 + 2 * index


def _last_index(domain: int) -> int:
    """Return the last participant index of a domain: `LAST_INDEX`, or less where the ports end."""
    return min(LAST_INDEX, (65535 - 1 - _port(domain, 0)) // 2)


def _of_domain(one: UdpSocket, domain: int) -> bool:
    """Whether a socket can be one of Cyclone's: a port of the domain, or the sending socket at a loopback address."""
    return 0 <= one.port - (7400 + 250 * domain) < 250 or ipaddress.ip_address(one.address).is_loopback


def _free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True


def _is_up(interface: str) -> bool:
    try:
        flags = int(Path(f"/sys/class/net/{interface}/flags").read_text(), 16)
    except OSError:  # no such interface, or no /sys: then ask by name only
        return not Path("/sys/class/net").exists() and interface in [name for _, name in socket.if_nameindex()]
    return bool(flags & 1)
