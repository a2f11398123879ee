"""Who may talk over zenoh: this machine, or those who prove themselves.

Without a configuration a session stays on the loopback interface. For another host it needs zenoh's own
TLS, or user and password, from a file in zenoh's format (``--bus-config``), of which the sections
``transport/link/tls`` and ``transport/auth/usrpwd`` are taken and nothing else. Multicast, gossip, plug-ins
and zenoh's shared memory stay off.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import json
import re
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from sprintlab.core.reading import read_text
from sprintlab.deployment.bus.address import BusAddress, BusError

_FIRST_PORT, _PORTS = 17447, 10000  # below the ports that systems hand out
_LARGEST_MESSAGE = 1 << 16  # bytes: zenoh alone would keep a stranger's gigabytes
_MOST_BRACKETS = 200  # of a configuration; zenoh's parser ends the process at some ten thousand
_TLS, _USERS = "transport/link/tls", "transport/auth/usrpwd"
_ROBOT_TLS = ("listen_certificate", "listen_private_key", "root_ca_certificate")
_CONTROLLER_TLS = ("connect_certificate", "connect_private_key", "root_ca_certificate")


@dataclass(frozen=True, kw_only=True)
class Security:
    """How two ends recognize each other.

    Attributes:
        tls: zenoh's section of that name; empty without TLS.
        user: of this end.
        password: of this end.
        users_file: of a robot's end: ``user:password``, one a line.
        users: passwords by user, from that file.
    """

    tls: dict[str, Any] = field(default_factory=dict)
    user: str = ""
    password: str = ""
    users_file: str = ""
    users: dict[str, str] = field(default_factory=dict)


def load_security(path: Path, *, robot: bool) -> Security:
    """Read how ends recognize each other from a file in zenoh's format.

    Args:
        path: JSON5 or JSON.
        robot: for the robot's end, which listens.

    Raises:
        BusError: the file cannot be read, or would let strangers in.
    """
    text = read_text(path, what="configuration", error=BusError)
    if text.count("[") + text.count("{") > _MOST_BRACKETS:
        raise BusError(f"{path} is no configuration of zenoh: it is nested too deeply")
    try:
        config = zenoh.Config.from_json5(text)  # unlike its own reading of files, it opens no others
        tls = _section(config, _TLS)
        users = _section(config, _USERS)
    except (zenoh.ZError, OSError, ValueError) as error:
        raise BusError(f"{path} is no configuration of zenoh{_where(error)}") from None
    security = Security(tls=tls, **_credentials(path, users, robot))
    if tls:
        _check_tls(path, tls, robot, users_checked=bool(users))
    if not (tls or users):
        raise BusError(f"{path} names neither {_TLS} nor {_USERS}: everybody could drive the robot")
    return security


def proof(password: str, challenge: bytes) -> bytes:
    """What shows that a robot knows the password of the user that asks."""
    return hmac.new(password.encode(), challenge, hashlib.sha256).digest()


def open_session(address: BusAddress, security: Security, *, listen: bool) -> Any:
    """A session at the address's place, or at the port that belongs to the robot's name.

    Raises:
        BusError: nobody is there, the place is taken, or it is another host and nothing protects it.
    """
    place = address.place or f"127.0.0.1:{_FIRST_PORT + zlib.crc32(address.name.encode()) % _PORTS}"
    if not place.rpartition(":")[2].isdecimal() or not place.rpartition(":")[0]:
        raise BusError(f"zenoh:// needs HOST:PORT behind the @, not {place!r}")
    if not (_is_loopback(place) or security.tls or security.user):
        raise BusError(
            f"{place} is not this machine: everybody on the network could drive the robot; "
            "give --bus-config with zenoh's TLS, or user and password"
        )
    config = _configuration(f"{'tls' if security.tls else 'tcp'}/{place}", address.name, security, listen)
    try:
        return zenoh.open(config)
    except (zenoh.ZError, OSError) as error:
        what = "listen at" if listen else "reach a robot at"
        hint = " (or it refuses this controller)" if security.user or security.tls else ""
        raise BusError(f"cannot {what} {place}{'' if listen else hint}: {_short(error)}") from error


def _access(name: str) -> dict[str, Any]:
    """What may pass a robot's end, and nothing else.

    zenoh hands on what a client says to all others: without these rules a stranger's states would reach the
    controller as the robot's, and the controller's commands the stranger.
    """
    state, fix, claim = (f"sprintlab/{name}/{key}" for key in ("state", "fix", "claim"))
    command, robot, controllers = (
        f"sprintlab/{name}/{key}" for key in ("command", "alive/robot", "alive/controller/*")
    )
    allowed = {
        "ingress": {
            "put": [command],
            "declare_subscriber": [state, fix],
            "query": [claim],
            "liveliness_token": [controllers],
            "declare_liveliness_subscriber": [robot],
            "liveliness_query": [robot],
        },
        "egress": {
            "put": [state, fix],
            "declare_subscriber": [command],
            "declare_queryable": [claim],
            "reply": [claim],
            "liveliness_token": [robot],
            "declare_liveliness_subscriber": [controllers],
            "liveliness_query": [controllers],
        },
    }
    rules = [
        {
            "id": f"{flow} {message}",
            "permission": "allow",
            "flows": [flow],
            "messages": [message],
            "key_exprs": keys,
        }
        for flow, messages in allowed.items()
        for message, keys in messages.items()
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "all"}],
        "policies": [{"rules": [rule["id"] for rule in rules], "subjects": ["all"]}],
    }


def _configuration(endpoint: str, name: str, security: Security, listen: bool) -> Any:
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": _LARGEST_MESSAGE,
        "listen/endpoints": [endpoint] if listen else [],
        "connect/endpoints": [] if listen else [endpoint],
        "listen/exit_on_failure": True,
        "connect/exit_on_failure": True,
        "connect/timeout_ms": 2000,
    }
    if security.tls:
        settings[_TLS] = security.tls
    if security.user:
        settings |= {f"{_USERS}/user": security.user, f"{_USERS}/password": security.password}
    if listen:
        settings["access_control"] = _access(name)
    if security.users_file:
        settings[f"{_USERS}/dictionary_file"] = security.users_file
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _section(config: Any, key: str) -> dict[str, Any]:
    """What a section sets."""
    return {name: value for name, value in json.loads(config.get_json(key)).items() if value is not None}


def _credentials(path: Path, section: dict[str, Any], robot: bool) -> dict[str, Any]:
    """User and password of this end; for a robot also those whom it lets in."""
    if not section:
        return {}
    user, password = section.get("user", ""), section.get("password", "")
    if not (user and password):
        raise BusError(f"{path}: {_USERS} needs user and password")
    found = {"user": user, "password": password}
    if not robot:
        return found
    file = Path(section.get("dictionary_file", ""))
    lines = read_text(file, what="user file", error=BusError).splitlines()
    users = dict(line.split(":", 1) for line in lines if ":" in line)
    if not users or not all(name and word for name, word in users.items()):
        # zenoh takes an empty file for "no authentication" and lets everybody in.
        raise BusError(f"{path}: the user file {file} must hold user:password, one a line, and holds none")
    return found | {"users_file": str(file), "users": users}


def _check_tls(path: Path, tls: dict[str, Any], robot: bool, *, users_checked: bool) -> None:
    needed = [name for name in (_ROBOT_TLS if robot else _CONTROLLER_TLS) if not users_checked or robot]
    missing = [name for name in needed if not (name in tls or f"{name}_base64" in tls)]
    if missing:
        raise BusError(f"{path}: {_TLS} needs {', '.join(missing)}")
    if not (tls.get("enable_mtls") or users_checked):
        raise BusError(f"{path}: {_TLS} needs enable_mtls, or anybody could connect")
    if tls.get("verify_name_on_connect") is False:
        raise BusError(f"{path}: {_TLS} must not switch verify_name_on_connect off")
    for name in tls.keys() & {*_ROBOT_TLS, *_CONTROLLER_TLS}:
        read_text(tls[name], what=name, error=BusError)  # zenoh would wait for a pipe for ever


def _where(error: Exception) -> str:
    """Where a configuration has an error, and nothing else of its text: passwords may stand in it."""
    place = re.search(r"(?:line: |--> )(\d+)(?:, column: |:)(\d+)", str(error))
    field = re.search(r"unknown field `\w+`|it is invalid|expected struct \w+", str(error))
    said = [field[0]] if field else []
    said += [f"line {place[1]}, column {place[2]}"] if place else []
    return ": " + ", ".join(said) if said else ""


def _is_loopback(place: str) -> bool:
    host = place.rpartition(":")[0].strip("[]")
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _short(error: Exception) -> str:
    """An error of zenoh without the places in its source, and without the passwords of a configuration."""
    return str(error).split(" at /")[0].partition(": {")[0]
