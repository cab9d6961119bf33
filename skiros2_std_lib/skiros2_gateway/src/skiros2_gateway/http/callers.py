"""The callers of requests: the arguments of routes with the authenticated caller and the gateway's model."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request
from starlette.types import Scope

from skiros2_gateway.core.access import AGENTS, Caller
from skiros2_gateway.core.problems import Unauthenticated
from skiros2_gateway.core.service import Service

#: The cookie of a page.
COOKIE = "skiros2_gateway"


def service_of(request: Request) -> Service:
    """Returns the service of the application."""
    service = request.app.state.service
    assert isinstance(service, Service)
    return service


def caller_of(request: Request) -> Caller:
    """Returns the authenticated caller of a request.

    :raises Unauthenticated: it has no valid credentials.
    :raises TooMany: too many failures of this address.
    """
    access, address, token = service_of(request).access, address_of(request), token_of(request)
    if token:
        return _known(request, access.authenticate(token, "rest", address))
    if COOKIE in request.cookies:
        if request.method not in ("GET", "HEAD") and request.headers.get("x-gateway") != "1":
            raise Unauthenticated("a command with the cookie needs the header X-Gateway: 1")
        return _known(request, service_of(request).sessions.caller(request.cookies[COOKIE]))
    return access.authenticate("", "rest", address)


def agent_of(request: Request) -> Caller:
    """Returns the authenticated caller of agents' tools; raises like `caller_of`. A page's cookie is not valid here."""
    access = service_of(request).access
    return _known(request, access.authenticate(token_of(request), AGENTS, address_of(request)))


def _known(request: Request, caller: Caller) -> Caller:
    set_known(request)
    return caller


def set_known(request: Request) -> None:
    """Notes that a request has valid credentials: its connection stays where others have to give way."""
    request.state.is_known = True


def is_known(scope: Scope) -> bool:
    """Returns whether a request was found to have valid credentials."""
    return bool(scope.get("state", {}).get("is_known"))


def address_of(request: Request) -> str:
    """Returns the address of a request's client."""
    return request.client.host if request.client else ""


def token_of(request: Request) -> str:
    """Returns the token of a request's header; "" without one."""
    kind, _, token = request.headers.get("authorization", "").partition(" ")
    return token.strip() if kind.lower() == "bearer" else ""


async def _caller(request: Request) -> Caller:
    return caller_of(request)


async def _service(request: Request) -> Service:
    return service_of(request)


# Functions that are not async would run in other threads: a third of the time of a short request, and beside the loop.
#: The authenticated caller as the argument of a route.
CallerArg = Annotated[Caller, Depends(_caller)]
#: The service as the argument of a route.
ServiceArg = Annotated[Service, Depends(_service)]
