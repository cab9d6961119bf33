"""Errors as answers: problem details (RFC 9457), in requests and in the OpenAPI document."""

from __future__ import annotations

from typing import Any, Literal

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.routing import Match

from skiros2_bags.core.bag_file import BagError
from skiros2_common.core.errors import Conflict, Refused, SkirosError, TimedOut, UnknownName, WrongType, WrongValue
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.keys import MAX_KEY
from skiros2_gateway.core.problems import Denied, Rejected, TooMany, Unauthenticated, WrongQuery, field_problems
from skiros2_gateway.http.callers import COOKIE

_STATUS: tuple[tuple[type[SkirosError], int], ...] = (
    (WrongQuery, 400), (Rejected, 422), (Denied, 403), (Unauthenticated, 401), (TooMany, 429), (UnknownName, 404),
    (Conflict, 409), (Refused, 409), (BagError, 409), (TimedOut, 503), (WrongValue, 422), (WrongType, 422),
)  # fmt: skip
#: The same by code: errors of services have one class for all codes.
_STATUS_OF_CODE = {kind.code: status for kind, status in _STATUS}

_MEDIA_TYPE = "application/problem+json"
_TEXTS = {
    400: "the query or body cannot be read", 401: "no valid credentials", 403: "the role is missing", 404: "unknown",
    405: "no such method", 408: "the body has not arrived in time", 409: "not in this state", 413: "too large",
    422: "wrong fields", 429: "too many requests", 500: "a mistake of the gateway", 503: "the cell does not answer",
}  # fmt: skip
#: The possible answers of each route.
_ALWAYS = (400, 401, 403, 405, 408, 413, 422, 429, 500, 503)
#: Commands, and the header that has one carried out once.
_COMMANDS = ("post", "put", "delete")
_KEY = {
    "name": "Idempotency-Key",
    "in": "header",
    "required": False,
    "description": "chosen by the client: a command that is sent again with its key is carried out once",
    "schema": {"type": "string", "minLength": 1, "maxLength": MAX_KEY, "pattern": "^[ -~]*$"},
}


class ProblemOfField(BaseModel):
    """A problem of a field."""

    code: str
    where: str
    message: str
    expected: str
    nearest: list[str]


class ProblemDetails(BaseModel):
    """An error. The request has changed nothing."""

    title: str
    status: int
    code: str
    detail: str
    problems: list[ProblemOfField] = []


def answers(model: type[BaseModel], *errors: Literal[404, 409], status: int = 200) -> dict[int | str, Any]:
    """Returns the argument `responses` of a route.

    The model only describes the answer: making it of each answer would cost more than the answer.

    :param errors: status codes beside those of each route.
    """
    return {status: {"model": model}, **errors_of(*errors)}


def errors_of(*errors: Literal[404, 409]) -> dict[int | str, Any]:
    """Returns the errors of a route for its argument `responses`."""
    schema = {"$ref": "#/components/schemas/ProblemDetails"}
    content = {"content": {_MEDIA_TYPE: {"schema": schema}}}
    return {status: {"description": _TEXTS[status], **content} for status in sorted({*_ALWAYS, *errors})}


#: The argument `responses` of a stream of events.
EVENTS: dict[int | str, Any] = {**errors_of(), 200: {"content": {"text/event-stream": {}}}}


def describe(app: FastAPI) -> dict[str, Any]:
    """Returns the OpenAPI document of an application, with the schemas of errors and the ways to authenticate."""
    if app.openapi_schema is None:
        document = get_openapi(title=app.title, version=app.version, routes=app.routes)
        components = document.setdefault("components", {})
        schema = ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
        components.setdefault("schemas", {}).update({**schema.pop("$defs"), "ProblemDetails": schema})
        components["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer"},
            "session": {"type": "apiKey", "in": "cookie", "name": COOKIE, "description": "commands need X-Gateway: 1"},
        }
        document["security"] = [{"token": []}, {"session": []}]
        for path, operations in document["paths"].items():
            for operation in (operations[method] for method in _COMMANDS if method in operations):
                if path != "/api/session":
                    operation.setdefault("parameters", []).append(_KEY)
                    operation["responses"].update({str(s): answer for s, answer in errors_of(409).items() if s == 409})
        app.openapi_schema = document
    return app.openapi_schema


def add_error_handlers(app: FastAPI) -> None:
    """Has errors of an application answered as problem details."""
    app.add_exception_handler(SkirosError, on_skiros_error)
    app.add_exception_handler(RequestValidationError, _on_wrong_fields)
    app.add_exception_handler(HTTPException, on_http_error)
    app.add_exception_handler(Exception, _on_mistake)


def problem(status: int, code: str, detail: str, **more: Any) -> Response:
    """Returns an answer with problem details."""
    data = {"title": code.replace("_", " "), "status": status, "code": code, "detail": detail, **more}
    return Response(json_text(data), status, media_type=_MEDIA_TYPE)  # also of names that are no UTF-8


async def on_skiros_error(_: Request, error: Exception) -> Response:
    """Answers an error of the platform."""
    assert isinstance(error, SkirosError)
    by_class = (status for kind, status in _STATUS if isinstance(error, kind))
    status = next(by_class, _STATUS_OF_CODE.get(error.code, 503))
    more = {"problems": [each.to_dict() for each in error.problems]} if isinstance(error, Rejected) else {}
    response = problem(status, error.code, str(error), **more)
    if isinstance(error, TooMany):
        response.headers["Retry-After"] = str(max(1, round(error.retry_after)))
    if status == 401:
        response.headers["WWW-Authenticate"] = "Bearer"
    return response


async def on_http_error(request: Request, error: Exception) -> Response:
    """Answers an error of the application, such as an unknown route."""
    assert isinstance(error, HTTPException)
    code = "too_large" if error.status_code == 413 else "http_error"
    response = problem(error.status_code, code, str(error.detail))
    response.headers.update(error.headers or {})
    if error.status_code == 405 and (methods := _methods(request)):
        response.headers["Allow"] = ", ".join(sorted(methods | {"HEAD"} if "GET" in methods else methods))
    return response


def _methods(request: Request) -> set[str]:
    """Returns the methods of a path; a route of the framework knows its own only."""
    found = [route for route in request.app.routes if route.matches(request.scope)[0] is not Match.NONE]
    return {method for route in found for method in getattr(route, "methods", None) or ()}


async def _on_mistake(_: Request, __: Exception) -> Response:
    """Answers a mistake in the gateway's code, which the server logs."""
    return problem(500, "internal_error", "a mistake in the gateway; its log has the details")


async def _on_wrong_fields(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    problems = field_problems(error.errors())
    detail = "; ".join(str(each) for each in problems)
    status = 400 if any(each.code == "json_invalid" for each in problems) else 422
    return problem(status, Rejected.code, detail, problems=[each.to_dict() for each in problems])
