"""Refuses requests that a page of another origin makes a browser send, also by a name that it has rebound (DNS)."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from urllib.parse import urlsplit

from fastapi import Request

from skiros2_gateway.core.problems import Denied


def check_origin(request: Request, hosts: Collection[str] = ()) -> None:
    """Checks the headers `Host` and `Origin`.

    An address cannot be rebound, so it is accepted as the host; other names are this machine's.

    :param hosts: further names of this machine.
    :raises Denied: the host is another one, or the request comes from a page of another origin.
    """
    host = request.headers.get("host", "")
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        name = ""
    known = {"localhost", socket.gethostname().lower(), *(each.lower() for each in hosts)}
    if name not in known and not _is_address(name):
        raise Denied(f"the header Host names {host!r}, expected an address or one of: {', '.join(sorted(known))}")
    origin = request.headers.get("origin")
    if origin is not None and origin != f"{request.url.scheme}://{host}":
        raise Denied(f"the request comes from a page of {origin!r}, expected {request.url.scheme}://{host}")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
